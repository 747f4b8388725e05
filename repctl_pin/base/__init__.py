"""Tools for all modules of the package: argument checks, errors, files, tables, progress."""
