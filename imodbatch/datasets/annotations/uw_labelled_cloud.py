"""UW RGB-D Scenes v2: boxes derived from a labelled cloud, its camera poses, and the depth images.

The dataset has no boxes. `annotations.path` names the cloud (pc/{number}.ply); its classes (.label)
and the poses of the frames (.pose) lie beside it. Each object of the cloud gives a box in every
frame that has it in view: around all its points, whether they are seen or not. A box is ignored
where the image's border cuts it, or where the depth image confirms too little of the object's front
(something stands before it, or no depth is known there).
"""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.boxes import area, clip
from imodbatch.core.cloud_boxes import Sight, box_of_points, is_in_front, sight_of_points
from imodbatch.core.depth import DepthImage, register
from imodbatch.core.errors import DataError
from imodbatch.core.frames import invert, is_rigid
from imodbatch.datasets.annotations.entries import KEY, UNKNOWN_CLASS, Entry, annotation_file
from imodbatch.datasets.base import CameraModel, Footage, FrameFile
from imodbatch.datasets.images import UnreadableImageError, read_depth
from imodbatch.datasets.labelled_clouds import CloudObject, cluster, read_labelled_cloud
from imodbatch.datasets.names import OUTSIDE_IMAGE, ClassNames, existing_file
from imodbatch.datasets.registry import camera_model, layout_of
from imodbatch.datasets.trajectories import read_odometry
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection

LABELS = {
    1: "bowl",
    2: "cap",
    3: "cereal_box",
    4: "coffee_mug",
    5: "coffee_table",
    6: "office_chair",
    7: "soda_can",
    8: "sofa",
    9: "table",
    10: "background",
}
BACKGROUND = (0, 10)
NO_POSE = "no pose"
"""Reason: nobody knows where the frame was taken."""
TOO_SMALL = "cluster too small"
"""Reason: a few stray points; counted once, not once per frame."""
MIN_VISIBLE_SHARE = 0.4
TOLERANCE_M, TOLERANCE_SHARE = 0.02, 0.02
PLAUSIBLE_RATIO = 3.0
"""Depth farther off than by this factor, nearly everywhere, is in another unit."""
NO_BOX = (0.0, 0.0, 0.0, 0.0)


def files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The cloud, its labels, the poses of its frames.

    Raises:
        ConfigError: the sequence has no number to put into the path.
        DataError: one of them is missing.
    """
    cloud = annotation_file(manifest, sequence)
    beside = (cloud.with_suffix(ending) for ending in (".label", ".pose"))
    return [cloud, *(existing_file(path, KEY) for path in beside)]


def read_entries(footage: Footage) -> Iterator[Entry]:
    """A box per object and frame; what is no box of an object in view says why.

    Raises:
        ConfigError: a rename to an unknown class; no number to put into the path.
        DataError: a file is missing or damaged; labels do not fit the cloud, poses the frames, or
            the unit of depth the cloud.
    """
    manifest, sequence, frames = footage.manifest, footage.sequence, footage.frames
    cloud, labels, poses = files(manifest, sequence)
    points, numbers = read_labelled_cloud(cloud, labels)
    unknown = sorted(set(np.unique(numbers).tolist()) - set(LABELS) - set(BACKGROUND))
    if unknown:
        raise DataError(
            f"{labels}: label {unknown[0]} is not one of 1 to {max(LABELS)}. Restore it."
        )
    classes = ClassNames(manifest, manifest.annotations.rename, "annotations.rename")
    objects: list[tuple[str, str, CloudObject]] = []
    for number, name in LABELS.items():
        of_class = points[numbers == number]
        if number in BACKGROUND or len(of_class) == 0 or not frames:
            continue
        where, first = f"{labels}: label {number}", frames[0].frame_index
        if classes.find(name) is None:
            yield Entry(where, first, name, NO_BOX, left_out=UNKNOWN_CLASS)
            continue
        found = cluster(of_class, manifest.annotations.cluster_gap_m)
        objects += [(name, f"{name}_{i}", thing) for i, thing in enumerate(found.objects, start=1)]
        for _ in range(found.n_too_small):
            yield Entry(where, first, name, NO_BOX, left_out=TOO_SMALL)
    world_from_color = _poses(manifest, sequence, poses)
    model = camera_model(manifest, sequence)
    yield from _boxes(manifest, model, frames, objects, world_from_color, cloud)


def _poses(
    manifest: Manifest, sequence: SequenceSection, path: Path
) -> dict[int, NDArray[np.float64]]:
    """Frame number → world_from_color in the cloud's world, where it is known."""
    whole = sequence.model_copy(update={"frames": None})
    section = OdometrySection(format="uw", path=str(path.resolve()))
    all_frames = layout_of(manifest).all_frames(manifest, sequence)
    read = read_odometry(section, manifest, whole, all_frames)
    known = is_rigid(read.world_from_color)
    numbers = read.frame_index[known].tolist() if read.frame_index is not None else []
    return dict(zip(numbers, read.world_from_color[known], strict=True))


def _boxes(
    manifest: Manifest,
    model: CameraModel,
    frames: Sequence[FrameFile],
    objects: Sequence[tuple[str, str, CloudObject]],
    world_from_color: dict[int, NDArray[np.float64]],
    cloud: Path,
) -> Iterator[Entry]:
    sights: list[Sight] = []
    for frame in frames:
        pose = world_from_color.get(frame.frame_index)
        color_from_world = None if pose is None else invert(pose)
        depth_m: DepthImage | None = None
        for name, instance_id, thing in objects:
            where = f"{cloud}: {instance_id} in frame {frame.frame_index}"
            if color_from_world is None:
                yield Entry(where, frame.frame_index, name, NO_BOX, left_out=NO_POSE)
                continue
            box = box_of_points(thing.hull, color_from_world, model.color)
            seen = clip(np.array([box or NO_BOX]), model.color.width_px, model.color.height_px)
            if box is None or area(seen)[0] <= 0:
                yield Entry(where, frame.frame_index, name, NO_BOX, left_out=OUTSIDE_IMAGE)
                continue
            depth_m = _depth(manifest, frame, model) if depth_m is None else depth_m
            sight = sight_of_points(
                thing.surface,
                thing.spacing_m,
                color_from_world,
                model.color,
                depth_m,
                TOLERANCE_M,
                TOLERANCE_SHARE,
            )
            sights.append(sight)
            is_whole = is_in_front(thing.hull, color_from_world) and (seen == box).all()
            is_ignored = bool(not is_whole or sight.share < MIN_VISIBLE_SHARE)
            yield Entry(
                where, frame.frame_index, name, box, is_ignored=is_ignored, instance_id=instance_id
            )
    _refuse_unit(sights, model, cloud)


def _depth(manifest: Manifest, frame: FrameFile, model: CameraModel) -> DepthImage:
    """Depth of a frame in its colour camera; all unknown where there is no image to read."""
    if frame.depth_path is not None:
        try:
            path = manifest.root_path / frame.depth_path
            depth_m = read_depth(path, model.depth_scale_m, model.depth_invalid)
            return register(depth_m, model.depth, model.color, model.color_from_depth)
        except UnreadableImageError:
            pass
    return np.full((model.color.height_px, model.color.width_px), np.nan, dtype=np.float32)


def _refuse_unit(sights: Sequence[Sight], model: CameraModel, cloud: Path) -> None:
    """Depth that is everywhere several times the cloud's distances would hide every object."""
    ratios = np.concatenate([sight.depth_ratios for sight in sights]) if sights else np.zeros(0)
    if len(ratios) == 0:
        return
    ratio = float(np.median(ratios))
    if not 1 / PLAUSIBLE_RATIO < ratio < PLAUSIBLE_RATIO:
        raise DataError(
            f"{cloud}: depth images lie {ratio:.3g} times as far as its points. Set "
            f"camera.depth.scale_m = {model.depth_scale_m / ratio:.1g} (it is "
            f"{model.depth_scale_m:g}), or check that cloud and images are of one scene."
        )
