"""What every room leans on: errors, files, tables, checks, workers and stores."""
