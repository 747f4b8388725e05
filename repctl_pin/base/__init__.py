"""What every module of the package may use: arguments, errors, files, tables, progress."""
