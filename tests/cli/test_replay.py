"""`mbvi replay` without a page: it serves until the user interrupts, and that is no error."""

import re
import signal
import sys
import urllib.request

import mbvi
from support.programs import LIMIT, environment, started


def test_a_live_replay_outlives_its_tab_and_ends_quietly(tmp_path):
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 1))
    mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1, progress=False).save(tmp_path / "run.h5")
    code = "from mbvi.cli.main import main; main(['replay', 'run.h5'])"
    variables = environment() | {"BROWSER": "true"}
    with started([sys.executable, "-u", "-c", code], cwd=tmp_path, env=variables) as program:
        address = next(found[0] for line in program.stdout if (found := re.search(r"http://\S+", line)))
        for _ in range(3):
            with urllib.request.urlopen(address, timeout=LIMIT) as page:
                assert b"replay" in page.read()
        assert "Ctrl-C" in program.stdout.readline()
        program.send_signal(signal.SIGINT)
        rest, errors = program.communicate(timeout=LIMIT)
    assert (program.returncode, rest, errors) == (0, "", "")
