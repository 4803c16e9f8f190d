"""torch's zip archives, untrusted: checked here, and rebuilt for torch to read.

Two readers of zip files can see different files in one archive. torch therefore does not read the
original file, but an archive built from the checked contents.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import PurePosixPath

import torch

from apil_core.common.errors import VictimError, reason_of
from apil_core.policies.foreign.origin import Origin

MAX_BYTES = 1 << 30
"""Largest unpacked content of an archive."""


def read_archive(origin: Origin, kind: str) -> dict[str, bytes]:
    """Content of a torch archive by name, without the folder that is around everything.

    Raises:
        VictimError: it is no such archive, or one that two readers could understand differently.
    """
    try:
        with zipfile.ZipFile(origin.path) as archive:
            entries = [entry for entry in archive.infolist() if not entry.is_dir()]
            if sum(entry.file_size for entry in entries) > MAX_BYTES:
                raise origin.wrong(f"{kind} of at most {MAX_BYTES >> 20} MB unpacked", "more")
            content = [(entry.filename, archive.read(entry)) for entry in entries]
    except VictimError:
        raise
    except Exception as error:  # zipfile raises half a dozen exception types for damaged files
        raise origin.wrong(f"{kind}, a zip archive", f"a file that is none ({reason_of(error)})") from error
    folders = {name.partition("/")[0] for name, _ in content}
    inner = [PurePosixPath(name.partition("/")[2]) for name, _ in content]
    plain = all(path.parts and ".." not in path.parts and not path.is_absolute() for path in inner)
    if len(folders) != 1 or not plain or len({str(path).lower() for path in inner}) != len(inner):
        raise origin.wrong(f"{kind}: one folder of distinct files", ", ".join(sorted(folders)) or "nothing")
    return {str(path): data for path, (_, data) in zip(inner, content, strict=True)}


def rebuilt(content: Mapping[str, bytes], version: int = 0) -> io.BytesIO:
    """A torch archive of just these entries, in order.

    Args:
        content: by name.
        version: of the operators; torch writes it into the archive itself.
    """
    buffer = io.BytesIO()
    writer = torch._C.PyTorchFileWriter(buffer)
    writer.set_min_version(version)
    for name, data in content.items():
        writer.write_record(name, data, len(data))
    writer.write_end_of_file()
    buffer.seek(0)
    return buffer
