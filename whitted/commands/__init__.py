"""The commands, one a module: each parses its arguments, calls the library and prints results."""
