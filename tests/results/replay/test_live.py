"""The live replay: a server on this machine, whose page can be closed and opened again."""

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
