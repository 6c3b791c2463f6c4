"""The package beside its public peers: mopeds and Pyomo.DoE design the same drive, one scorer judges all."""
