"""Commands that join from other modules and packages, by entry point in `imodbatch.commands`.

The lab's `simulate`, `synth` and `train` come this way: the pipeline imports none of its code. A
module is imported when its command is called or listed, so it should import click alone.
"""

import os
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from imodbatch.core.errors import ConfigError

if TYPE_CHECKING:
    from imodbatch.settings.manifest import Manifest

GROUP = "imodbatch.commands"
LAB = "pip install 'imodbatch[lab]'"


class PluggedGroup(click.Group):
    """A group with commands of its own, and after them those that join."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """In the order they were added, not of the alphabet."""
        del ctx
        return [*self.commands, *sorted(_joining().keys() - self.commands.keys())]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """A command of its own comes before one that joins."""
        own = super().get_command(ctx, cmd_name)
        if own is not None:
            return own
        entry = _joining().get(cmd_name)
        return None if entry is None else _load(entry)


def make_data(manifest: "Manifest", n_workers: int) -> None:
    """Let `simulate` make the data of a manifest that says how; it leaves whole data as they are.

    It is looked for among the commands that the one in progress belongs to.

    Args:
        manifest: with or without ``[simulate]``.
        n_workers: worlds at a time; two at least where there are two processors.

    Raises:
        ConfigError: the data are missing, and so is `simulate`.
    """
    if manifest.simulate is None:
        return
    root = click.get_current_context().find_root()
    group = root.command
    simulate = group.get_command(root, "simulate") if isinstance(group, click.Group) else None
    if simulate is None or isinstance(simulate, _Broken):
        if manifest.root_path.is_dir():
            return
        raise ConfigError(
            f"manifest {manifest.name}: {manifest.root_path.resolve()} is missing, and so is "
            f"`imodbatch simulate`, which makes it. Install it: {LAB}"
        )
    target = (manifest.root_path / manifest.simulate.folder).resolve()
    here = Path.cwd()
    shown = target.relative_to(here) if target.is_relative_to(here) else target
    arguments = [str(shown), *manifest.simulate.options()]
    if manifest.simulate.world != "analytic":  # which is quick, and takes no workers
        arguments += ["--workers", str(max(n_workers, min(2, os.cpu_count() or 1)))]
    simulate.main(arguments, "simulate", standalone_mode=False, parent=root)


class _Broken(click.Command):
    """Stands for a command that cannot be loaded, and says why when it is called."""

    def __init__(self, name: str, fault: str) -> None:
        anything = {"ignore_unknown_options": True, "allow_extra_args": True}
        super().__init__(name, help=fault, context_settings=anything)

    def invoke(self, ctx: click.Context) -> Any:
        """Say what is wrong."""
        del ctx
        raise ConfigError(self.help or "")


@cache  # all installed packages are searched
def _joining() -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=GROUP)}


def _load(entry: EntryPoint) -> click.Command:
    """The command, or one that says why it is none."""
    owner = entry.dist.name if entry.dist else "another package"
    cure = LAB if owner == "imodbatch" else f"Update or remove {owner}."
    try:
        command = entry.load()
    except Exception as error:  # a foreign module may raise anything on import
        reason = " ".join(str(error).split()) or type(error).__name__
        return _Broken(entry.name, f"{entry.name}: cannot be loaded ({reason}): {cure}")
    if not isinstance(command, click.Command):
        return _Broken(entry.name, f"{entry.name}: {entry.value} is no click command. {cure}")
    return command
