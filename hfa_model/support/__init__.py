"""What every room leans on: errors, files, the front door."""
