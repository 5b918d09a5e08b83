"""The command line: parse, call, print one line per stage and sequence."""
