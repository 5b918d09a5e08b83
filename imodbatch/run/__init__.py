"""One run: which step gets what, what is up to date, and the folder it is written to."""
