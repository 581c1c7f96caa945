"""The live replay: a server on this machine, whose page can be closed and opened again."""

import html
import os
import re
import subprocess
import sys
import threading
import urllib.error
import urllib.request
import webbrowser

import pytest

import mbvi
from mbvi.results.replay.live import replay
from mbvi.results.replay.replay import page_of
from support.programs import LIMIT


@pytest.fixture(scope="module")
def run():
    scene = mbvi.Scene()
    scene.add_sphere(0.1, position=(0, 0, 1))
    return mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1, progress=False)


def fetched(address):
    with urllib.request.urlopen(address, timeout=LIMIT) as answer:
        return answer.read().decode()


def test_a_page_is_sent_as_often_as_it_is_opened(run, monkeypatch, capsys):
    threads = []

    def browser(url):
        threads.append(threading.Thread(target=fetched, args=(url,)))
        threads[0].start()

    monkeypatch.setattr(webbrowser, "open", browser)
    server = replay(run, speed=0.5)
    threads[0].join(timeout=LIMIT)
    assert server.address in capsys.readouterr().out
    for _ in range(2):
        assert fetched(server.address) == page_of(run, speed=0.5).html()
    with pytest.raises(urllib.error.HTTPError, match="404"):
        fetched(server.address + "other")
    server.close()
    with pytest.raises(urllib.error.URLError):
        fetched(server.address)


# a shell with a kernel, as a notebook has; what is displayed goes to its publisher
CELL = """
import sys, mbvi
from IPython.core.displaypub import CapturingDisplayPublisher
from IPython.core.interactiveshell import InteractiveShell
shell = InteractiveShell.instance()
shell.kernel = None
shell.display_pub = CapturingDisplayPublisher(shell=shell)
mbvi.load(sys.argv[1]).replay(speed=0.5)
(shown,) = shell.display_pub.outputs
open(sys.argv[2], "w").write(shown["data"]["text/html"])
"""


def test_a_notebook_shows_the_page_below_its_cell(run, tmp_path):
    pytest.importorskip("IPython")
    run.save(tmp_path / "run.h5")
    command = [sys.executable, "-c", CELL, tmp_path / "run.h5", tmp_path / "cell.html"]
    subprocess.run(command, check=True, timeout=LIMIT, env={**os.environ, "IPYTHONDIR": str(tmp_path)})
    shown = (tmp_path / "cell.html").read_text()
    page = html.unescape(re.search('srcdoc="([^"]*)"', shown)[1])
    assert page == page_of(mbvi.load(tmp_path / "run.h5"), speed=0.5).html()
