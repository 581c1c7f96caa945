"""Problems with exact solutions, once a process, because those of mechanisms are integrated when they are made."""

from __future__ import annotations

import pytest

from mbvi.reference import references

# by restitution and name
CASES = {(e, case.name): case for e in (0.0, 0.5, 1.0) for case in references(e)}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=[f"{name}, e = {e:g}" for e, name in CASES])
