"""Any folder of RGB-D frames, read by the manifest alone: `[camera]`, `[images]`, `[odometry]`."""

from pathlib import Path

import numpy as np

from imodbatch.core.errors import ConfigError, DataError
from imodbatch.core.trajectory import associate
from imodbatch.datasets.base import NS_PER_MS, NS_PER_S, CameraModel, FrameFile, nanoseconds
from imodbatch.datasets.layout import Layout, frame_file, registered
from imodbatch.datasets.patterns import PathPattern
from imodbatch.datasets.text import read_lines
from imodbatch.settings.manifest import Manifest, SequenceSection
from imodbatch.settings.sections import ImagesSection


def _frames(manifest: Manifest, sequence: SequenceSection) -> list[FrameFile]:
    """Colour images by number, each with its depth image (same number or name; nearest stamp)."""
    images, color = _images(manifest)
    base = manifest.root_path / sequence.path
    numbered = color.find(base)
    stamps = _timestamps(images, color, numbered, base)
    depth_of = _depth_by_number(images, color, numbered, base)
    return [
        frame_file(manifest.root_path, number, path, stamp, depth_of)
        for (number, path), stamp in zip(numbered, stamps, strict=True)
    ]


def _cameras(manifest: Manifest, _sequence: SequenceSection | None) -> CameraModel:
    """A folder says nothing of its cameras: depth is taken as millimetres, registered to colour."""
    section = manifest.camera
    if section.color is None:
        raise ConfigError(
            f"manifest {manifest.name}: adapter 'folder' needs camera.color with width_px, "
            "height_px, fx_px, fy_px, cx_px, cy_px."
        )
    return registered(manifest, section.color.camera(section.pixel_origin))


def _files(manifest: Manifest, sequence: SequenceSection) -> list[Path]:
    """The file of timestamps, if `[images]` names one."""
    timestamps = None if manifest.images is None else manifest.images.timestamps
    return [] if timestamps is None else [manifest.root_path / sequence.path / timestamps]


def _images(manifest: Manifest) -> tuple[ImagesSection, PathPattern]:
    if manifest.images is None or manifest.images.color is None:
        raise ConfigError(
            f"manifest {manifest.name}: adapter 'folder' needs an [images] section with "
            "color, such as color = 'color/{frame}.png'."
        )
    return manifest.images, PathPattern(manifest.images.color)


def _timestamps(
    images: ImagesSection, color: PathPattern, numbered: list[tuple[int, Path]], base: Path
) -> list[int | None]:
    if color.field == "stamp":
        return list(_stamps_ns(color, base))
    if images.timestamps is not None:
        path = base / images.timestamps
        lines = read_lines(path, "Give it a stamp in seconds per line, or check images.timestamps.")
        try:
            texts = [text for line in lines if (text := line.split("#")[0].strip())]
            stamps = [nanoseconds(text.split()[0]) for text in texts]
        except ValueError as error:
            raise DataError(f"{path}: expected a stamp in seconds per line ({error}).") from None
        if len(stamps) != len(numbered):
            raise DataError(
                f"{path}: {len(stamps)} stamps for {len(numbered)} colour images. "
                "images.timestamps needs one line per image."
            )
        return list(stamps)
    if images.frames_per_second is not None:
        return [round(number * NS_PER_S / images.frames_per_second) for number, _ in numbered]
    return [None] * len(numbered)


def _stamps_ns(pattern: PathPattern, base: Path) -> list[int]:
    """Stamps of the files that fit a {stamp} pattern, in the order of their numbers."""
    try:
        return [nanoseconds(text) for text in sorted(pattern.values(base), key=float)]
    except ValueError as error:
        raise DataError(
            f"{base / pattern.pattern}: {error}. Use {{name}} instead of {{stamp}}, with "
            "images.timestamps."
        ) from None


def _depth_by_number(
    images: ImagesSection, color: PathPattern, numbered: list[tuple[int, Path]], base: Path
) -> dict[int, Path]:
    if images.depth is None:
        return {}
    depth = PathPattern(images.depth)
    if depth.field != color.field:
        raise ConfigError(
            f"images.depth {images.depth!r} has {{{depth.field}}} where images.color has "
            f"{{{color.field}}}; both need the same."
        )
    if color.field == "frame":
        return dict(depth.find(base))
    by_text = depth.values(base)
    if color.field == "name":
        number_of = {path: number for number, path in numbered}
        return {
            number_of[path]: by_text[t] for t, path in color.values(base).items() if t in by_text
        }
    texts = sorted(by_text, key=float)
    partner = associate(
        np.array(_stamps_ns(color, base), dtype=np.int64),
        np.array(_stamps_ns(depth, base), dtype=np.int64),
        round(images.max_gap_ms * NS_PER_MS),
    )
    return {
        number: by_text[texts[j]]
        for (number, _), j in zip(numbered, partner, strict=True)
        if j >= 0
    }


LAYOUT = Layout(
    _frames,
    _cameras,
    images="the patterns of [images]",
    images_keys=frozenset(ImagesSection.model_fields),
    other_files=_files,
)
