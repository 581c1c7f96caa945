"""What pyproject.toml cannot say: machine code in a wheel, and the addresses of the repository where it is released."""

from __future__ import annotations

import os
import platform
import re
import sys
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface


class MachineCode(BuildHookInterface):
    """Adds the folder MBVI_MACHINE_CODE to a wheel, see tools/wheel.py; without it the wheel is of any platform."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Add the folder, and name Python and platform in the wheel's name."""
        folder = os.environ.get("MBVI_MACHINE_CODE")
        if not folder or version == "editable":
            return
        build_data["force_include"][folder] = "mbvi/compiled/machine_code"
        build_data["pure_python"] = False
        if sys.platform == "linux":
            # it needs no more of the C library than numba and Pinocchio do, whose wheels have this tag
            python = f"cp{sys.version_info.major}{sys.version_info.minor}"
            build_data["tag"] = f"{python}-{python}-manylinux_2_28_{platform.machine()}"
        else:
            build_data["infer_tag"] = True


class Addresses(MetadataHookInterface):
    """Makes README.md the description of the package.

    Where MBVI_REPOSITORY is the address of the repository, it becomes the project's address, and links and pictures of
    the description lead there: readers of the description have no files beside it.
    """

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the description, and the addresses."""
        text = (Path(self.root) / "README.md").read_text()
        repository = os.environ.get("MBVI_REPOSITORY", "").rstrip("/")
        if repository:
            text = with_addresses(text, repository, f"v{metadata['version']}")
            metadata["urls"] = {
                "Repository": repository,
                "Documentation": f"{repository}/blob/v{metadata['version']}/docs/index.md",
                "Changelog": f"{repository}/blob/v{metadata['version']}/CHANGELOG.md",
                "Issues": f"{repository}/issues",
            }
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def with_addresses(text: str, repository: str, version: str) -> str:
    """Return a page whose links to files, and pictures, are addresses of the files in a version of the repository."""

    def address(found: re.Match[str]) -> str:
        picture, words, target = found.groups()
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/{version}/{target})"

    return re.sub(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)]+)\)", address, text)
