"""What a report must be told that stands in no table."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class RunInfo:
    """The run as its manifest and pipeline name it.

    Attributes:
        title: the manifest's name.
        description: free text on the data; may be empty.
        pipeline_name: which experiment.
        classes: names by class id.
        versions: package → version.
        settings: pipeline section → key → value.
        summaries: (stage, sequence, summary line).
        created: moment of the report, given so that equal input makes equal bytes.
    """

    title: str
    description: str
    pipeline_name: str
    classes: tuple[str, ...]
    versions: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    summaries: tuple[tuple[str, str, str], ...] = ()
    created: str = ""

    def setting(self, section: str, key: str) -> Any:
        """A setting, or None where the run does not say."""
        return self.settings.get(section, {}).get(key)

    def class_name(self, class_id: int) -> str:
        """The name of a class; foreign ids keep their number."""
        return self.classes[class_id] if 0 <= class_id < len(self.classes) else f"class {class_id}"
