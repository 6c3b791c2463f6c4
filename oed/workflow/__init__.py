"""What is done with a study: run, validated, estimated, continued."""
