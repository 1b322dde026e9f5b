"""Pictures and videos for the tests of readers: what is written, how it is damaged."""

import re
from fractions import Fraction

import av
import numpy as np
from scipy.ndimage import gaussian_filter


def film(count=8, shape=(64, 96), noise=1.0, seed=0):
    """A texture that drifts, shape (count, *shape), uint8."""
    rng = np.random.default_rng(seed)
    ground = gaussian_filter(rng.normal(size=(shape[0] + count, shape[1] + 2 * count)), 1.2)
    ground = 128 + 40 * ground / ground.std()
    frames = [ground[k : k + shape[0], 2 * k : 2 * k + shape[1]] for k in range(count)]
    return np.clip(np.rint(frames + rng.normal(0, noise, (count, *shape))), 0, 255).astype(np.uint8)


def planar(pixels, pixel_format):
    """A frame of PyAV whose first plane holds exactly these 8-bit pixels; colours are neutral."""
    frame = av.VideoFrame(pixels.shape[1], pixels.shape[0], pixel_format)
    for number, plane in enumerate(frame.planes):
        values = np.full((plane.height, plane.line_size), 128, np.uint8)
        if number == 0:
            values[:, : pixels.shape[1]] = pixels
        plane.update(values.tobytes())
    return frame


def write_video(
    path, frames, codec, pixel_format="gray", *, stamps=None, unit=Fraction(1, 25), gop=None, **options
):
    """Write frames, shape (n, h, w), at time stamps in `unit`, or one a unit; `q` fixes the quantiser."""
    quantiser = options.pop("q", None)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=25, options={k: str(v) for k, v in options.items()})
        stream.height, stream.width, stream.pix_fmt = *frames.shape[1:], pixel_format
        stream.codec_context.time_base = unit
        if gop:
            stream.codec_context.gop_size = gop
        if quantiser:
            stream.codec_context.qmin = stream.codec_context.qmax = quantiser
        for number, pixels in enumerate(frames):
            frame = planar(pixels, pixel_format)
            frame.pts, frame.time_base = (number if stamps is None else stamps[number]), unit
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def jpeg_starts(data):
    """Places of the JPEG pictures in a file."""
    return [found.start() for found in re.finditer(b"\xff\xd8\xff", data)]


def packet_places(path):
    """Place and size of every packet of a video, in the order of decoding."""
    with av.open(str(path)) as container:
        return [
            (packet.pos, packet.size) for packet in container.demux(container.streams.video[0]) if packet.size
        ]


def overwrite(path, target, at, piece):
    """Copy a file with a piece of it replaced."""
    data = bytearray(path.read_bytes())
    data[at : at + len(piece)] = piece
    target.write_bytes(data)
    return target
