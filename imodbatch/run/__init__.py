"""One run: which step gets what, what is up to date, and the folder it is written to.

- `steps`: the pipeline as a list; `step` says what one is, `plan` what it may use.
- `indexing`, `posing`, `detecting`, `fusing`, `judging`: how each is done.
- `runner`: up to date? read → step → write; `provenance`, `stored`, `states`, `workers`, `lock`.
- `publishing`, `exporting`: the report, trajectory files.
- `library`: the stages as functions on arrays and tables.
"""
