"""Videos, decoded again with the library that wrote them."""

from __future__ import annotations

import re
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image

from apil_core import ApilError
from apil_core.common.extras import install_command
from apil_core.evaluation.video.mp4 import Mp4Writer, check_mp4, pace


@pytest.mark.parametrize(
    ("step", "speed", "fps", "stride", "rate"),
    [
        (0.015, 1.0, 30.0, 2, Fraction(100, 3)),  # 1 / (30 · 0.015) = 2.2 steps a frame
        (0.015, 1.0, 70.0, 1, Fraction(200, 3)),
        (0.015, 0.25, 30.0, 1, Fraction(50, 3)),  # slow motion: a step lasts 0.06 s
        (0.05, 1.0, 30.0, 1, Fraction(20)),
        (0.015, 4.0, 30.0, 9, Fraction(800, 27)),
    ],
)
def test_frames_keep_time(step: float, speed: float, fps: float, stride: int, rate: Fraction) -> None:
    assert pace(step, speed, fps) == (stride, rate)
    assert stride * step / speed == pytest.approx(float(1 / rate))


def test_a_video_holds_what_was_added(tmp_path: Path) -> None:
    path = tmp_path / "video.mp4"
    video = Mp4Writer(path, 64, 48, Fraction(25))
    for shade in (0, 120, 240):
        video.add(Image.new("RGB", (64, 48), (shade, shade, shade)))
    video.add(Image.new("RGB", (64, 48), (250, 0, 0)), seconds=0.4)
    assert not path.exists()
    video.close()
    with av.open(str(path)) as container:
        stream = container.streams.video[0]
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(stream)]
        assert stream.average_rate == 25
        assert stream.codec_context.name == "h264"
        assert stream.codec_context.pix_fmt == "yuv420p"
    assert len(frames) == video.frames == 3 + 10
    assert frames[0].shape == (48, 64, 3)
    for frame, shade in zip(frames, (0, 120, 240), strict=False):
        assert abs(frame.mean() - shade) < 6
    assert np.abs(frames[-1].mean((0, 1)) - [250, 0, 0]).max() < 12
    assert [file.name for file in tmp_path.iterdir()] == ["video.mp4"]


def test_a_discarded_video_leaves_nothing(tmp_path: Path) -> None:
    for frames in (0, 2):
        video = Mp4Writer(tmp_path / "video.mp4", 64, 48, Fraction(25))
        for _ in range(frames):
            video.add(Image.new("RGB", (64, 48)))
        video.discard()
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "size", "message"),
    [("video.avi", (64, 48), r"\.mp4"), ("video.mp4", (63, 48), "even"), ("video.mp4", (64, 49), "64 × 49")],
)
def test_what_cannot_be_written_is_said_before(name: str, size: tuple[int, int], message: str) -> None:
    with pytest.raises(ApilError, match=message):
        check_mp4(Path(name), *size)


def test_a_missing_library_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(ApilError, match=re.escape(f"videos need PyAV: {install_command('video')}")):
        check_mp4(Path("video.mp4"), 64, 48)
