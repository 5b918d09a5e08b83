"""What the manifests that lie beside the data have in common."""

import json
import re
from dataclasses import asdict

from imodbatch.core.camera import PinholeCamera


def safe_name(folder_name: str) -> str:
    """A folder's name with what may not stand in a dataset's name replaced."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", folder_name).lstrip("._-") or "houses"


def quoted(text: str) -> str:
    """A TOML string; JSON escapes the same characters in the same way."""
    return json.dumps(text, ensure_ascii=False)


def camera_fields(camera: PinholeCamera) -> str:
    """What stands between the braces of a TOML inline table."""
    return ", ".join(f"{field} = {value}" for field, value in asdict(camera).items())
