"""An mp4 from raw frames, by the ffmpeg of imageio-ffmpeg or of the system."""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
from pathlib import Path
from typing import Any


class Video:
    """Film that grows frame by frame; without ffmpeg it drops frames and sets ``trouble``."""

    def __init__(self, path: Path, width: int, height: int, fps: int) -> None:
        self.path = path
        self.trouble = ""
        self._process: subprocess.Popen[bytes] | None = None
        program = _ffmpeg()
        if program is None:
            self.trouble = "no ffmpeg: pip install 'hqp[video]', or the system's package ffmpeg"
            return
        path.parent.mkdir(parents=True, exist_ok=True)
        source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", str(fps), "-i", "-"]
        target = [
            "-an",
            "-vcodec",
            "libx264",
            "-pix_fmt",
            "yuv420p",
            "-crf",
            "26",
            "-movflags",
            "+faststart",
            str(path),
        ]
        command = [program, "-y", "-loglevel", "error", *source, *target]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE)

    def add(self, frame: Any) -> None:
        """Append an image ``(height, width, 3)`` of bytes."""
        if self._process is None or self._process.stdin is None:
            return
        try:
            self._process.stdin.write(frame.tobytes())
        except BrokenPipeError:
            self.close()

    def close(self) -> bool:
        """Finish the film; return true if there is one."""
        if self._process is None:
            return False
        _, errors = self._process.communicate()
        if self._process.returncode:
            self.trouble = errors.decode(errors="replace").strip() or f"ffmpeg ended with {self._process.returncode}"
        self._process = None
        return not self.trouble


def _ffmpeg() -> str | None:
    if importlib.util.find_spec("imageio_ffmpeg") is not None:
        import imageio_ffmpeg

        return str(imageio_ffmpeg.get_ffmpeg_exe())
    return shutil.which("ffmpeg")
