"""A dataset layout: what its folders say wherever the manifest says nothing else."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from imodbatch.core.camera import PinholeCamera
from imodbatch.core.errors import ConfigError
from imodbatch.datasets.base import CameraModel, FrameFile, Odometry
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.trajectories import read_odometry, trajectory_files
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import AnnotationsSection, ImagesSection, OdometrySection

T = TypeVar("T")
OfSequence = Callable[[Manifest, SequenceSection], T]


def always(value: T) -> Callable[[Manifest, SequenceSection | None], T]:
    """What is the same for all sequences."""
    return lambda _manifest, _sequence: value


NO_POSES: OfSequence[OdometrySection | None] = always(None)
NO_FILES: OfSequence[Sequence[Path]] = always(())


@dataclass(frozen=True)
class Layout:
    """A dataset layout.

    Attributes:
        all_frames: every frame of a sequence by rising number, also outside the manifest's slice.
        cameras: of a sequence, where the manifest does not override them. Without a sequence, where
            each has cameras of its own, the intrinsics are typical ones.
        images: where the images come from, in a few words.
        images_keys: the keys of `[images]` that mean something.
        own_poses: the `[odometry]` that comes with a sequence; None = the dataset has none.
        true_poses: the `[reference]`, taken only if its files are there.
        own_boxes: the `[annotations]`, taken only if the file is there.
        other_files: files besides images and poses that frames and cameras are read from, for
            provenance; they may be missing.
        first_number: number that the layout gives to its first frame.
    """

    all_frames: OfSequence[list[FrameFile]]
    cameras: Callable[[Manifest, SequenceSection | None], CameraModel]
    images: str
    images_keys: frozenset[str] = frozenset()
    own_poses: OfSequence[OdometrySection | None] = NO_POSES
    true_poses: OfSequence[OdometrySection | None] = NO_POSES
    own_boxes: AnnotationsSection | None = None
    other_files: OfSequence[Sequence[Path]] = NO_FILES
    first_number: int = 0

    def frames(self, manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
        """The frames of a sequence that the manifest's slice keeps, by rising number.

        Raises:
            DataError: a list of images or stamps is missing or damaged.
        """
        every = self.all_frames(manifest, sequence)
        return [frame for frame in every if sequence.keeps(frame.frame_index)]

    def odometry_section(
        self, manifest: Manifest, sequence: SequenceSection
    ) -> OdometrySection | None:
        """How the poses that come with a sequence are read; None = there are none."""
        return manifest.odometry or self.own_poses(manifest, sequence)

    def _reference_section(
        self, manifest: Manifest, sequence: SequenceSection
    ) -> OdometrySection | None:
        if manifest.reference is not None:
            return manifest.reference
        own = self.true_poses(manifest, sequence)
        return own if any(p.is_file() for p in _files(own, manifest, sequence)) else None

    def odometry(self, manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
        """The poses that come with a sequence; None = there are none.

        Raises:
            DataError: a file is missing or damaged.
        """
        return self._read(self.odometry_section(manifest, sequence), manifest, sequence)

    def odometry_files(self, manifest: Manifest, sequence: SequenceSection) -> list[Path]:
        """Files that `odometry` reads, for provenance."""
        return _files(self.odometry_section(manifest, sequence), manifest, sequence)

    def reference(self, manifest: Manifest, sequence: SequenceSection) -> Odometry | None:
        """True poses, by which others are judged and nothing else is done; None = none.

        Raises:
            DataError: a file is missing or damaged.
        """
        return self._read(self._reference_section(manifest, sequence), manifest, sequence)

    def reference_files(self, manifest: Manifest, sequence: SequenceSection) -> list[Path]:
        """Files that `reference` reads, for provenance."""
        return _files(self._reference_section(manifest, sequence), manifest, sequence)

    def _read(
        self, section: OdometrySection | None, manifest: Manifest, sequence: SequenceSection
    ) -> Odometry | None:
        if section is None:
            return None
        every = self.all_frames(manifest, sequence)
        return read_odometry(section, manifest, sequence, every, self.first_number)

    def refuse_images(self, manifest: Manifest) -> None:
        """Refuse keys of `[images]` that nothing would look at.

        Raises:
            ConfigError: there is one.
        """
        given = (manifest.images or ImagesSection()).model_fields_set
        if in_vain := given - self.images_keys:
            raise ConfigError(
                f"manifest {manifest.name}: images.{min(in_vain)} means nothing to the adapter "
                f"{manifest.adapter!r}, which takes images from {self.images}. Take it out, or use "
                "the adapter 'folder'."
            )


def _files(
    section: OdometrySection | None, manifest: Manifest, sequence: SequenceSection
) -> list[Path]:
    return [] if section is None else trajectory_files(section, manifest, sequence)


def paired_frames(
    root: Path, folder: Path, color: Iterable[PathPattern], depth: PathPattern
) -> list[FrameFile]:
    """Colour images of a folder by number, each with the depth image of its number.

    Args:
        root: of the dataset; paths are relative to it.
        folder: where the images lie.
        color: patterns of the colour images, with ``{frame}``; of two images of one number the one
            that fits the later pattern counts.
        depth: pattern of the depth images.
    """
    colored = {number: path for pattern in color for number, path in pattern.find(folder)}
    depth_of = dict(depth.find(folder))
    return [
        frame_file(root, number, path, None, depth_of) for number, path in sorted(colored.items())
    ]


def frame_file(
    root: Path, number: int, color: Path, timestamp_ns: int | None, depth_of: dict[int, Path]
) -> FrameFile:
    """A frame with the depth image of its number, if there is one; paths become relative."""
    depth = depth_of.get(number)
    return FrameFile(
        number,
        timestamp_ns,
        color.relative_to(root).as_posix(),
        None if depth is None else depth.relative_to(root).as_posix(),
    )


def registered(
    manifest: Manifest, color: PinholeCamera, depth_scale_m: float = 0.001
) -> CameraModel:
    """One camera for both images, that of the manifest if it gives one; 0 = no depth.

    Args:
        manifest: the split.
        color: the camera where the manifest gives none.
        depth_scale_m: metres per unit of a depth image.
    """
    section = manifest.camera
    if section.color is not None:
        color = section.color.camera(section.pixel_origin)
    return CameraModel(color, color, depth_scale_m, depth_invalid=(0,))
