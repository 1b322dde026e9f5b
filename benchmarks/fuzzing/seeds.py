"""Seeds: one small whole file of every kind that is read, made here."""

from __future__ import annotations

import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import h5py
import numpy as np
import tifffile
import zarr
from PIL import Image

import sixflow
from sixflow import synth
from sixflow.write import RecordingWriter

SHAPE = (48, 64)
FILM = synth.sequence(
    synth.Speckle(seed=1), synth.Affine.translation(0.7, -0.3), SHAPE, 4, sensor=synth.Sensor(noise=1, bits=8)
).frames
COLOUR = np.stack([FILM[0], FILM[1], FILM[2]], axis=-1)

Maker = Callable[[Path], object]


def tiffs() -> dict[str, Maker]:
    """TIFF: pages, stacks, tiles, ImageJ and OME metadata, compressions that need no other package."""
    deep = (FILM.astype(np.uint16) * 200).astype(np.uint16)
    return {
        "pages.tif": lambda path: tifffile.imwrite(path, FILM, photometric="minisblack", metadata=None),
        "shaped.tif": lambda path: tifffile.imwrite(path, deep, photometric="minisblack"),
        "big.tif": lambda path: tifffile.imwrite(path, FILM, bigtiff=True, byteorder=">"),
        "tiled.tif": lambda path: tifffile.imwrite(path, FILM, tile=(16, 16), photometric="minisblack"),
        "deflate.tif": lambda path: [
            Image.fromarray(FILM[0]).save(
                path,
                compression="tiff_adobe_deflate",
                save_all=True,
                append_images=[Image.fromarray(FILM[1])],
            )
        ],
        "lzw.tif": lambda path: Image.fromarray(FILM[0]).save(path, compression="tiff_lzw"),
        "colour.tif": lambda path: tifffile.imwrite(path, COLOUR, photometric="rgb"),
        "float.tif": lambda path: tifffile.imwrite(path, FILM.astype(np.float32), photometric="minisblack"),
        "imagej.tif": lambda path: tifffile.imwrite(
            path,
            FILM,
            imagej=True,
            resolution=(2, 2),
            metadata={"axes": "TYX", "finterval": 0.5, "unit": "um"},
        ),
        "ome.ome.tif": lambda path: tifffile.imwrite(
            path,
            FILM,
            photometric="minisblack",
            metadata={"axes": "TYX", "TimeIncrement": 2.0, "PhysicalSizeX": 0.5, "PhysicalSizeXUnit": "µm"},
        ),
    }


def images() -> dict[str, Maker]:
    """Image files of one frame."""
    grey, colour = Image.fromarray(FILM[0]), Image.fromarray(COLOUR)
    alpha = colour.copy()
    alpha.putalpha(Image.fromarray(FILM[3]))
    deep = Image.fromarray(FILM[0].astype(np.uint16) * 200)
    return {
        "grey.png": grey.save,
        "deep.png": deep.save,
        "alpha.png": alpha.save,
        "palette.png": colour.quantize(16).save,
        "grey.jpg": lambda path: grey.save(path, quality=90),
        "colour.jpg": lambda path: colour.save(path, quality=80, progressive=True),
        "grey.bmp": grey.save,
        "grey.pgm": grey.save,
        "colour.webp": lambda path: colour.save(path, quality=80),
        "grey.jp2": lambda path: grey.save(path, irreversible=True),
    }


def videos() -> dict[str, Maker]:
    """Videos: containers and codecs."""
    kinds = {
        "raw.avi": ("rawvideo", "gray"),
        "mjpeg.avi": ("mjpeg", "yuvj420p"),
        "h264.mp4": ("libx264", "yuv420p"),
        "h265.mp4": ("libx265", "yuv420p"),
        "mpeg4.mov": ("mpeg4", "yuv420p"),
        "ffv1.mkv": ("ffv1", "gray"),
        "vp9.webm": ("libvpx-vp9", "yuv420p"),
        "mpeg2.ts": ("mpeg2video", "yuv420p"),
        "film.gif": ("gif", "gray"),
        "raw.y4m": ("wrapped_avframe", "yuv420p"),
    }
    return {
        name: lambda path, kind=kind: _video(path, *kind)
        for name, kind in kinds.items()
        if kind[0] in av.codecs_available
    }


def _video(path: Path, codec: str, pixels: str) -> None:
    options = {"x265-params": "log-level=none"} if codec == "libx265" else {}
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options=options)
        stream.height, stream.width, stream.pix_fmt = *SHAPE, pixels
        for number, frame in enumerate(FILM):
            picture = av.VideoFrame.from_ndarray(np.ascontiguousarray(frame), format="gray").reformat(
                format=pixels
            )
            picture.pts, picture.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(picture))
        container.mux(stream.encode())


def arrays() -> dict[str, Maker]:
    """Arrays in files: NumPy, HDF5, Zarr."""
    return {
        "film.npy": lambda path: np.save(path, FILM),
        "film.npz": lambda path: np.savez_compressed(path, film=FILM),
        "film.h5": _hdf5,
        "film.zarr": lambda path: zarr.save_array(str(path), FILM),
        "ome.zarr": _ome_zarr,
    }


def _hdf5(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file.create_dataset("film", data=FILM, chunks=(1, 24, 64), compression="gzip")


def _ome_zarr(path: Path) -> None:
    root = zarr.open_group(str(path), mode="w", zarr_format=2)
    root.create_array("0", data=FILM, chunks=(1, 48, 64))
    axes = [{"name": "t", "type": "time", "unit": "second"}] + [
        {"name": name, "type": "space", "unit": "micrometer"} for name in "yx"
    ]
    scale = [{"type": "scale", "scale": [2.0, 0.5, 0.5]}]
    datasets = [{"path": "0", "coordinateTransformations": scale}]
    root.attrs["multiscales"] = [{"version": "0.4", "axes": axes, "datasets": datasets}]


def fields() -> dict[str, Maker]:
    """Field files, and a recording that was interrupted."""
    field = sixflow.measure_sequence(FILM, window=15, step=8)
    return {
        "field.nc": lambda path: sixflow.write_field(field, path),
        "field.zarr": lambda path: sixflow.write_field(field, path),
        "stopped.zarr.partial": lambda path: _interrupted(path, field),
    }


def _interrupted(path: Path, field: object) -> None:
    writer = RecordingWriter(path.with_suffix(""), identity={"frames": "4"}, batch=1)
    try:
        with writer:
            for time in range(2):
                writer.append(field.isel(time=[time]))  # type: ignore[attr-defined]
            raise KeyboardInterrupt
    except KeyboardInterrupt:
        pass


def settings() -> dict[str, Maker]:
    """Settings files."""
    text = 'window = 41\nstep = 4\nlighting = "gain+offset"\npixel_size = 0.05\nlength_unit = "mm"\nsharpen = 2\n'
    return {"settings.toml": lambda path: path.write_text(text, encoding="utf-8")}


def masks() -> dict[str, Maker]:
    """Masks: pictures, labels, arrays, regions of ImageJ."""
    inside = np.zeros(SHAPE, np.uint8)
    inside[8:40, 8:56] = 1
    made: dict[str, Maker] = {
        "mask.png": Image.fromarray(inside * 255).save,
        "labels.png": Image.fromarray(inside, "P").save,
        "mask.tif": lambda path: tifffile.imwrite(path, inside.astype(np.uint16)),
        "mask.npy": lambda path: np.save(path, inside.astype(bool)),
    }
    try:
        import roifile
    except ImportError:
        return made
    polygon, other = (
        roifile.ImagejRoi.frompoints(points, name=name)
        for name, points in (("a", [[8, 8], [56, 8], [30, 40]]), ("b", [[4, 4], [20, 4], [4, 30]]))
    )
    made["region.roi"] = lambda path: polygon.tofile(str(path))
    made["regions.zip"] = lambda path: roifile.roiwrite(str(path), [polygon, other])
    return made


KINDS: dict[str, Callable[[], dict[str, Maker]]] = {
    "frames": lambda: tiffs() | images() | videos() | arrays(),
    "field": fields,
    "settings": settings,
    "mask": masks,
}
"""What is read, and the seeds of it."""


def make_seeds(folder: Path) -> list[tuple[str, Path]]:
    """Write all seeds to folders named by their kind; (kind, path) of each."""
    made = []
    for kind, makers in KINDS.items():
        (folder / kind).mkdir()
        for name, make in makers().items():
            make(folder / kind / name)
            made.append((kind, folder / kind / name))
    (folder / "seeds.json").write_text(
        json.dumps([(kind, str(path)) for kind, path in made]), encoding="utf-8"
    )
    return made
