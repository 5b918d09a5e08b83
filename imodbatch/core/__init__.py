"""The method in pure numpy: no I/O, nothing heavier than numpy."""
