"""COLMAP's mappers: matches in, camera poses and points in arbitrary units out.

The camera is known and stays as it is. COLMAP may return several models that it could not join.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imodbatch.core.errors import DataError, ImodError, one_line
from imodbatch.poses.sfm.colmap import SEED, Progress, n_threads, pycolmap
from imodbatch.poses.sfm.features import feature_scales
from imodbatch.poses.sfm.workspace import Database
from imodbatch.tables.atomic import scratch_folder

MIN_MODEL_SIZE = 3
MIN_FIRM_POINTS = 50  # with 30 or 40, COLMAP now and then takes one wall for another
SMALLEST_GAIN = 1e-6  # of a bundle adjustment, to go on
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sights:
    """What one image of a model sees.

    Attributes:
        pixels: (n, 2).
        points: (n, 3) reconstructed there, in the model's world.
        scale_px: (n,) size of the features, which bounds how well their pixels are known.
    """

    pixels: Array
    points: Array
    scale_px: Array

    def take(self, rows: NDArray[np.generic]) -> "Sights":
        """Some of them."""
        return Sights(self.pixels[rows], self.points[rows], self.scale_px[rows])


@dataclass(frozen=True)
class Model:
    """One reconstruction; keyframes are named by their position in the sequence.

    Attributes:
        reconstruction: COLMAP's.
        scales_px: keyframe → sizes (N,) of all its features, as `feature_scales` reads them.
    """

    reconstruction: Any
    scales_px: dict[int, Array]

    def keyframes(self) -> list[int]:
        """Positions of the keyframes it holds, rising."""
        return sorted(image_id - 1 for image_id in self.reconstruction.reg_image_ids())

    def firm_keyframes(self) -> list[int]:
        """Those of the keyframes that see enough points for their pose to be trusted."""
        image = self.reconstruction.image
        return [k for k in self.keyframes() if image(k + 1).num_points3D >= MIN_FIRM_POINTS]

    def cam_from_world(self, keyframe: int) -> Array:
        """Pose (4, 4) in the model's units."""
        rows = self.reconstruction.image(keyframe + 1).cam_from_world().matrix()
        return np.vstack([rows, [0.0, 0.0, 0.0, 1.0]])

    def point_ids(self, keyframe: int) -> NDArray[np.int64]:
        """COLMAP's ids (n,) of the points that `sights` gives."""
        seen = self.reconstruction.image(keyframe + 1).get_observation_points2D()
        return np.array([p.point3D_id for p in seen], dtype=np.int64)

    def sights(self, keyframe: int) -> Sights:
        """Pixels with a reconstructed point."""
        image = self.reconstruction.image(keyframe + 1)
        seen = image.get_observation_points2D()
        rows = image.get_observation_point2D_idxs()
        points = self.reconstruction.points3D
        return Sights(
            np.array([p.xy for p in seen]).reshape(-1, 2),
            np.array([points[p.point3D_id].xyz for p in seen]).reshape(-1, 3),
            self.scales_px[keyframe][np.array(rows, dtype=np.int64)],
        )

    def move(self, cam_from_world: dict[int, Array], points: dict[int, Array]) -> None:
        """Put keyframes (4, 4) and points (3,) elsewhere, each by its position and COLMAP's id."""
        for keyframe, pose in cam_from_world.items():
            frame = self.reconstruction.image(keyframe + 1).frame
            frame.rig_from_world = pycolmap().Rigid3d(pose[:3])
        for point_id, xyz in points.items():
            self.reconstruction.point3D(point_id).xyz = xyz
        self.reconstruction.update_point_3d_errors()


def reconstruct(
    database: Database, image_root: Path, mapper: str, where: str, progress: Progress
) -> list[Model]:
    """Reconstruct the keyframes.

    Args:
        database: features and matches.
        image_root: folder of the images, for the colours of the points.
        mapper: ``incremental`` or ``global``.
        where: name of the sequence, for errors.
        progress: wraps the keyframes as they are added.

    Returns:
        Models with the one of most keyframes first.

    Raises:
        DataError: nothing could be reconstructed.
        ImodError: this build of pycolmap lacks the mapper, or the mapper failed.
    """
    run = _global if mapper == "global" else _incremental
    try:
        with scratch_folder(database.path.with_name("mapping")) as output:
            found = run(database, image_root, output, progress)
    except (RuntimeError, ValueError, IndexError) as error:
        text = one_line(error)
        raise ImodError(
            f"{where}: COLMAP's {mapper} mapper failed ({text}). "
            f"Set sfm.mapper = '{'incremental' if mapper == 'global' else 'global'}'."
        ) from None
    scales_px = feature_scales(database.path, database.keyframes)
    models = [Model(found[index], scales_px) for index in sorted(found)]
    models = [model for model in models if len(model.keyframes()) > 1]
    if not models:
        raise _nothing_found(database, where)
    return sorted(models, key=lambda model: -len(model.keyframes()))


def _incremental(
    database: Database, image_root: Path, output: Path, progress: Progress
) -> dict[int, Any]:
    colmap = pycolmap()
    options = colmap.IncrementalPipelineOptions(
        num_threads=n_threads(),
        random_seed=SEED,
        min_model_size=MIN_MODEL_SIZE,
        ba_refine_focal_length=False,
        ba_refine_principal_point=False,
        ba_refine_extra_params=False,
        ba_global_function_tolerance=SMALLEST_GAIN,
    )
    options.mapper.random_seed = SEED
    options.mapper.abs_pose_refine_focal_length = False
    options.mapper.abs_pose_refine_extra_params = False
    options.triangulation.random_seed = SEED
    added: Iterator[Any] = iter(progress(database.keyframes))
    found = colmap.incremental_mapping(
        database.path,
        image_root,
        output,
        options,
        next_image_callback=lambda: next(added, None),
    )
    for _ in added:  # lets the progress bar end
        pass
    return dict(found)


def _global(
    database: Database, image_root: Path, output: Path, progress: Progress
) -> dict[int, Any]:
    del progress
    colmap = pycolmap()
    if not hasattr(colmap, "global_mapping"):
        raise RuntimeError(f"pycolmap {colmap.__version__} is built without it")
    options = colmap.GlobalPipelineOptions(num_threads=n_threads(), random_seed=SEED)
    options.mapper.random_seed = SEED
    options.mapper.rotation_averaging.random_seed = SEED
    options.mapper.global_positioning.random_seed = SEED
    options.mapper.global_positioning.use_gpu = False
    options.mapper.retriangulation.random_seed = SEED
    options.mapper.bundle_adjustment.refine_focal_length = False
    options.mapper.bundle_adjustment.refine_extra_params = False
    options.mapper.bundle_adjustment.ceres.use_gpu = False
    return dict(colmap.global_mapping(database.path, image_root, output, options))


def _nothing_found(database: Database, where: str) -> DataError:
    colmap = pycolmap()
    opened = colmap.Database.open(database.path)
    n_features, n_verified = opened.num_keypoints(), opened.num_verified_image_pairs()
    n_matched = opened.num_matched_image_pairs()
    opened.close()
    return DataError(
        f"{where}: nothing could be reconstructed from {len(database.keyframes)} keyframes with "
        f"{n_features / len(database.keyframes):.0f} features each ({n_verified} of {n_matched} "
        "pairs agree on a motion). Images need texture, and the camera must move and not only "
        "turn; else use poses.source = 'slam' or 'odometry'."
    )
