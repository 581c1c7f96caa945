"""`mbvi replay` without a page: it serves until the user interrupts, and that is no error."""

import re
import signal
import subprocess
import sys
import urllib.request

import mbvi
from support.programs import environment


def test_a_live_replay_outlives_its_tab_and_ends_quietly(tmp_path):
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 1))
    mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1, progress=False).save(tmp_path / "run.h5")
    code = "from mbvi.cli.main import main; main(['replay', 'run.h5'])"
    with subprocess.Popen(
        [sys.executable, "-u", "-c", code], cwd=tmp_path, env=environment() | {"BROWSER": "true"},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    ) as program:  # fmt: skip
        address = next(found[0] for line in program.stdout if (found := re.search(r"http://\S+", line)))
        for _ in range(3):
            with urllib.request.urlopen(address, timeout=20) as page:
                assert b"replay" in page.read()
        assert "Ctrl-C" in program.stdout.readline()
        program.send_signal(signal.SIGINT)
        rest, errors = program.communicate(timeout=20)
    assert (program.returncode, rest, errors) == (0, "", "")
