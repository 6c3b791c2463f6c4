"""Parts of pages: sections, tables, numbers in words."""
