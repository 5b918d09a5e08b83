"""COLMAP's database of a sequence: made once, and used again while nothing it depends on changes.

The workspace holds ``database.db``, ``database.json`` (what it was made of, written after it) and
``sparse`` (the model, in metres). Everything is made under another name and then renamed.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from imodbatch.core.errors import DataError, ImodError
from imodbatch.poses.rgbd import RgbdFrames
from imodbatch.poses.sfm.colmap import SEED, Progress, n_threads, pycolmap
from imodbatch.poses.sfm.features import write_features
from imodbatch.poses.sfm.keyframes import select_keyframes
from imodbatch.poses.sfm.retrieval import Pairs, choose_pairs
from imodbatch.settings.config import SfmConfig
from imodbatch.tables.atomic import replacing_folder, scratch_folder, write_text

LAYOUT = 1  # raised when features, pairs or their files come about in another way
PAIRS_AT_ONCE = 100
MIN_KEYFRAMES = 2


@dataclass(frozen=True)
class Database:
    """Features and matches of the keyframes.

    Attributes:
        path: of the database file.
        keyframes: positions, rising.
        unreadable: positions of frames whose image cannot be read.
        is_reused: it was there already.
    """

    path: Path
    keyframes: list[int]
    unreadable: list[int]
    is_reused: bool = False


def provide_database(
    frames: RgbdFrames, workspace: Path, config: SfmConfig, progress: Progress
) -> Database:
    """The database of these frames and settings, made anew unless it is there.

    Raises:
        DataError: fewer than two keyframes.
        ImodError: the workspace cannot be written.
    """
    path, record = workspace / "database.db", workspace / "database.json"
    digest = _digest(frames, config)
    kept = _read_record(record)
    if kept.get("digest") == digest and path.is_file():
        return Database(path, kept["keyframes"], kept["unreadable"], is_reused=True)
    try:
        workspace.mkdir(parents=True, exist_ok=True)
        for old in (record, path):
            old.unlink(missing_ok=True)
        made = _make(frames, path, config, progress)
        content = {"digest": digest, "keyframes": made.keyframes, "unreadable": made.unreadable}
        write_text(record, json.dumps(content) + "\n")
    except OSError as error:
        raise ImodError(
            f"{workspace}: cannot be written ({error}). Choose another --out."
        ) from None
    return made


def keep_model(reconstruction: Any, workspace: Path) -> Path:
    """Write a model in COLMAP's format as ``sparse`` in place of an older one."""
    with replacing_folder(workspace / "sparse") as folder:
        reconstruction.write_binary(folder)
    return workspace / "sparse"


def _make(frames: RgbdFrames, path: Path, config: SfmConfig, progress: Progress) -> Database:
    chosen = select_keyframes(frames, config.keyframe_motion_percent, progress)
    keyframes = chosen.positions
    if len(keyframes) < MIN_KEYFRAMES:
        raise DataError(
            f"{frames.sequence_id}: {len(keyframes)} of {len(frames)} frames shows something new, "
            f"structure from motion needs {MIN_KEYFRAMES} at least. Give more frames, lower "
            "sfm.keyframe_motion_percent, or use poses.source = 'slam' or 'odometry'."
        )
    with scratch_folder(path) as folder:
        unfinished = folder / path.name
        database = pycolmap().Database.open(unfinished)
        try:
            write_features(database, frames, keyframes, config.max_features, progress)
            descriptors = [database.read_descriptors(position + 1).data for position in keyframes]
            names = [database.read_image(position + 1).name for position in keyframes]
        finally:
            database.close()
        pairs = choose_pairs(descriptors, config.next_keyframes, config.alike_keyframes)
        _match(unfinished, names, pairs, progress)
        unfinished.replace(path)
    return Database(path, keyframes, chosen.unreadable)


def _match(database: Path, names: list[str], pairs: Pairs, progress: Progress) -> None:
    """Match pairs of images and verify the matches; RANSAC is seeded per pair."""
    colmap = pycolmap()
    matching = colmap.FeatureMatchingOptions(num_threads=n_threads(), use_gpu=False)
    verification = colmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = SEED
    listing = database.with_suffix(".pairs.txt")
    pairing = colmap.ImportedPairingOptions(match_list_path=listing)
    for start in progress(range(0, len(pairs), PAIRS_AT_ONCE)):
        lines = [f"{names[i]} {names[j]}\n" for i, j in pairs[start : start + PAIRS_AT_ONCE]]
        listing.write_text("".join(lines), encoding="utf-8")
        colmap.match_image_pairs(database, matching, pairing, verification, colmap.Device.cpu)


def _digest(frames: RgbdFrames, config: SfmConfig) -> str:
    """Of all that the database depends on; files count by name, size and time of change."""
    content = {
        "layout": LAYOUT,
        "pycolmap": pycolmap().__version__,
        "camera": asdict(frames.camera),
        "settings": config.model_dump(exclude={"mapper", "adjust_to_depth", "max_gap_frames"}),
        "files": [_stamp(path) for path in frames.color_files],
    }
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _stamp(path: Path) -> tuple[str, int, int]:
    try:
        status = path.stat()
    except OSError:
        return str(path), -1, -1
    return str(path), status.st_size, status.st_mtime_ns


def _read_record(record: Path) -> dict[str, Any]:
    try:
        content = json.loads(record.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}
