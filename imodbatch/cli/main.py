"""The command line: one group of commands, and the only place where errors are caught.

Heavy libraries load inside the commands, so that ``imodbatch --help`` answers at once.
"""

import io
import sys
from typing import Any, NoReturn

import click

from imodbatch.cli.compare import compare
from imodbatch.cli.doctor import doctor
from imodbatch.cli.export import export
from imodbatch.cli.plugins import PluggedGroup
from imodbatch.cli.schema import schema
from imodbatch.cli.stages import stage_commands
from imodbatch.cli.status import status
from imodbatch.core.errors import ImodError
from imodbatch.core.version import __version__


class _OneLineErrors(PluggedGroup):
    """Errors a user can cure are one line on stderr and exit code 1."""

    def main(self, *args: Any, **kwargs: Any) -> Any:
        """Run; what the terminal's encoding lacks (→ in Latin-1) is printed as a question mark."""
        if isinstance(sys.stdout, io.TextIOWrapper) and sys.stdout.errors == "strict":
            sys.stdout.reconfigure(errors="replace")
        return super().main(*args, **kwargs)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; the only place where errors are caught."""
        try:
            return super().invoke(ctx)
        except ImodError as error:
            _fail(str(error))
        except BrokenPipeError:  # the reader of our output has seen enough; click ends quietly
            raise
        except (PermissionError, FileNotFoundError, FileExistsError, NotADirectoryError) as error:
            _fail(f"{error.filename}: {error.strerror}. Check the path and its permissions.")
        except OSError as error:
            _fail(f"{error.filename or 'disk'}: {error.strerror or error}.")


def _fail(message: str) -> NoReturn:
    click.echo(f"imodbatch: error: {message}", err=True)
    sys.exit(1)


@click.group(
    cls=_OneLineErrors,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: imodbatch run analytic",
)
@click.version_option(__version__, prog_name="imodbatch")
def main() -> None:
    """Many RGB-D frames made to agree: detect, lift, fuse and score objects over camera views."""


for _command in (*stage_commands(), status, export, schema, doctor, compare):
    main.add_command(_command)


if __name__ == "__main__":
    main()
