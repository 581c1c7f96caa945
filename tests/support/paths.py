"""Where the repository, its data for tests, its robots and the published robots are."""

import sysconfig
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]
ROOT = TESTS.parent
DATA = TESTS / "data"
DOCS = ROOT / "docs"
EXAMPLES = ROOT / "examples"
ROBOTS = ROOT / "robots"
REAL_ROBOTS = Path(sysconfig.get_path("purelib")) / "cmeel.prefix/share/example-robot-data/robots"


def real_robot(path: str) -> Path:
    file = REAL_ROBOTS / path
    assert file.is_file(), "example-robot-data is part of the test extra: pip install -e .[test]"
    return file
