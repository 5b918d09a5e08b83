"""Boxes held against the truth: matches, metrics, and what holds fusion back.

- `match`, `metrics` (with `background`, `coco`): the stage score.
- `sweep`, `losses`, `jitter`: the stage diagnose; `rescoring` fuses and scores again in memory.
"""
