"""Reports of results: text, tables, checks, pictures and files."""
