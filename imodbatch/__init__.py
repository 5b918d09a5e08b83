"""imodbatch: many RGB-D frames made to agree on what stands where.

manifest → index → poses → detect → lift → fuse → score → report

- `schemas`   what flows between the stages: every table, its columns and key
- `core`      the method in pure numpy; start with `core.fusion`
- `datasets`  raw folder → frames, annotations, odometry
- `engines`   the only importers of torch, open3d, pycolmap
- `stages`    one file per arrow; `stages.lift` shows what a stage is
- `runner`    up to date? read → stage → write
- `library`   the stages as functions on arrays and tables: the names below
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from imodbatch.core.camera import PinholeCamera as Camera
    from imodbatch.core.errors import ImodError
    from imodbatch.run.library import detect, estimate_poses, fuse, lift, score

__version__ = "0.1.0"
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
