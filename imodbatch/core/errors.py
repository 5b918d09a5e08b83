"""One family of errors, each a single line: where, what was found, what was expected, the cure.

The command line catches `ImodError` at its entry point, prints the line and exits with 1. Anything
else that escapes is a bug of ours and keeps its traceback.
"""


class ImodError(Exception):
    """Base of every error that a user can cause and cure."""


class ConfigError(ImodError):
    """A pipeline or manifest says something that cannot be meant."""


class DataError(ImodError):
    """A file of a dataset is missing, damaged or not what the manifest says it is."""


class TableError(ImodError):
    """A Parquet table is missing, breaks its schema or holds a key twice."""


class RunLockedError(ImodError):
    """Another command is writing in the run folder."""


def one_line(error: BaseException) -> str:
    """The text of another library's error, in one line."""
    return " ".join(str(error).split())
