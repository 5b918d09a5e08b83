"""imodbatch: many RGB-D frames made to agree on what stands where.

manifest → index → poses → detect → lift → fuse → score → report

- `schemas`   what flows between the stages: every table, its columns and key
- `core`      the method in pure numpy; start with `core.fusion`
- `datasets`  raw folder → frames, annotations, odometry
- `engines`   the only importers of torch, open3d, pycolmap
- `stages`    one file per arrow; `stages.lift` shows what a stage is
- `runner`    up to date? read → stage → write
"""

__version__ = "0.1.0"
