"""imodbatch: many RGB-D frames made to agree on what stands where.

manifest → index → poses → detect → lift → fuse → score → diagnose → report

One room per arrow; imports point down this list only:

- `cli`                              the command line
- `run`, `lab`                       steps, resume, the library below; datasets and detectors made
- `reporting`, `checkup`             report and comparisons; the doctor
- `scoring`                          matches, metrics, what holds fusion back
- `fusion`, `detection`, `poses`     lift and fuse; the detector; odometry, SLAM, SfM, levelling
- `datasets`                         raw folder → frames, annotations, odometry, images
- `tables`, `settings`, `libraries`  what flows; what can be turned; large libraries made to import
- `core`                             the method in pure numpy; start with `core.fusion`

The names below are the stages as functions on arrays and tables.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from imodbatch.core.version import __version__ as __version__

if TYPE_CHECKING:
    from imodbatch.core.camera import PinholeCamera as Camera
    from imodbatch.core.errors import ImodError
    from imodbatch.run.library import detect, estimate_poses, fuse, lift, score


__all__ = ["Camera", "ImodError", "detect", "estimate_poses", "fuse", "lift", "score"]


def __getattr__(name: str) -> Any:
    """Load a name of the library when it is first asked for: ``import imodbatch`` stays light."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    if name == "Camera":
        return import_module("imodbatch.core.camera").PinholeCamera
    home = "imodbatch.core.errors" if name == "ImodError" else "imodbatch.run.library"
    return getattr(import_module(home), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
