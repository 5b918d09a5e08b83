"""The sequence under examination: its files, its cameras, its poses as the manifest reads them."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from imodbatch.core.errors import ImodError
from imodbatch.core.trajectory import Trajectory
from imodbatch.datasets.base import CameraModel, FrameFile, Odometry
from imodbatch.datasets.registry import annotated, camera_model, layout_of
from imodbatch.poses.association import from_odometry
from imodbatch.settings.config import PosesConfig
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import OdometrySection

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Subject:
    """One sequence as its manifest describes it.

    Attributes:
        manifest: the split.
        sequence: the sequence.
        files: its F frames, at least one.
        cameras: of all frames.
    """

    manifest: Manifest
    sequence: SequenceSection
    files: list[FrameFile]
    cameras: CameraModel

    @classmethod
    def of(cls, manifest: Manifest, sequence: SequenceSection) -> "Subject":
        """The sequence, its files listed.

        Raises:
            ImodError: the manifest cannot be meant, or a file of stamps is damaged.
        """
        files = layout_of(manifest).frames(manifest, sequence)
        cameras = camera_model(manifest, sequence)
        return cls(annotated(manifest, sequence), sequence, files, cameras)

    @property
    def frame_index(self) -> NDArray[np.int64]:
        """(F,) the dataset's own frame numbers."""
        return np.array([file.frame_index for file in self.files], dtype=np.int64)

    @property
    def timestamp_ns(self) -> NDArray[np.int64] | None:
        """(F,) moments; None where one is unknown."""
        stamps = [file.timestamp_ns for file in self.files]
        if not stamps or any(stamp is None for stamp in stamps):
            return None
        return np.array(stamps, dtype=np.int64)

    @cached_property
    def odometry(self) -> Odometry | ImodError | None:
        """The poses that come with the sequence; the error if they cannot be read; None = none."""
        try:
            return layout_of(self.manifest).odometry(self.manifest, self.sequence)
        except ImodError as error:
            return error

    @cached_property
    def trajectory(self) -> Trajectory | ImodError | None:
        """The poses of the frames, as the poses stage would give them."""
        odometry = self.odometry
        if not isinstance(odometry, Odometry):
            return odometry
        keys = {
            "sequence_id": pa.array([self.sequence.id] * len(self.files), pa.string()),
            "frame_index": pa.array(self.frame_index, pa.int32()),
            "timestamp_ns": pa.array([file.timestamp_ns for file in self.files], pa.int64()),
        }
        try:
            return from_odometry(pa.table(keys), odometry, PosesConfig())
        except ImodError as error:
            return error

    @property
    def world_from_cam(self) -> Array | None:
        """(F, 4, 4) of the colour camera, NaN = lost; None = no poses at all."""
        trajectory = self.trajectory
        return trajectory.poses.world_from_cam if isinstance(trajectory, Trajectory) else None

    @property
    def odometry_section(self) -> OdometrySection | None:
        """How the poses are read: the manifest's section, or what the layout takes by default."""
        return layout_of(self.manifest).odometry_section(self.manifest, self.sequence)

    def name_of(self, position: int) -> str:
        """A frame for a sentence."""
        return f"frame {self.files[position].frame_index}"
