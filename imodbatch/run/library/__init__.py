"""The stages as functions on arrays and tables in memory: no manifest, pipeline file or run folder.

`imodbatch.estimate_poses`, `detect`, `lift`, `fuse` and `score` call what the command line calls,
and give DataFrames with the columns that `pd.read_parquet` finds in a run's folder.

- `poses`, `stages`: the functions. `settings`: their keyword arguments.
- `images`, `tables`, `fitting`: what a caller gives, completed and checked.
"""

from imodbatch.run.library.poses import estimate_poses
from imodbatch.run.library.stages import detect, fuse, lift, score

__all__ = ["detect", "estimate_poses", "fuse", "lift", "score"]
