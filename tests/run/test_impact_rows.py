"""Which rows take part in an impact, against plain forms."""

import numpy as np
import pytest
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

import mbvi
from mbvi.run.fixed_steps import taking
from mbvi.run.recording.impact_rows import RecentPercussions, linked

SCHEMES = [
    mbvi.Paoli(), mbvi.Paoli(project_positions=True), mbvi.MoreauJean(), mbvi.Centered(),
    mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip


def components(jacobian, chosen, seeds, parts):
    """Return what `linked` returns, by the components of the graph of rows and parts."""
    row, column = jacobian[chosen].nonzero()
    count = np.count_nonzero(chosen)
    edges = coo_array((np.ones(len(row)), (row, count + parts[column])), shape=(count + parts[-1] + 1,) * 2)
    label = connected_components(edges, directed=False)[1][:count]
    found = np.zeros(len(chosen), bool)
    found[chosen] = np.isin(label, label[seeds[chosen]])
    return found


@pytest.mark.parametrize("sparse", [False, True])
@pytest.mark.parametrize("seed", range(20))
def test_linked_rows_are_those_in_the_components_of_seeds(seed, sparse):
    rng = np.random.default_rng(seed)
    parts = np.repeat(np.arange(12), 3)
    J = np.zeros((15, len(parts)))
    for row in J:
        for part in rng.choice(12, rng.integers(0, 3), replace=False):
            row[parts == part] = rng.normal(size=3)
    chosen = rng.random(15) < 0.7
    seeds = chosen & (rng.random(15) < 0.2)
    found = linked(csr_array(J) if sparse else J, chosen, seeds, parts)
    np.testing.assert_array_equal(found, components(J, chosen, seeds, parts))


def test_recent_percussions_are_those_of_the_last_steps_without_impacts():
    rng, recent, steps, struck = np.random.default_rng(1), RecentPercussions(3), [], set()
    for asked in rng.random(200) < 0.5:
        number, percussion = rng.integers(0, 9, 12), rng.normal(size=12)
        if asked:
            before = [pair for one in steps[-3:] for pair in one]
            level = [max([0.0, *(p for n, p in before if n == k)]) for k in number]
            np.testing.assert_array_equal(recent.exceeded(number, percussion), percussion > 2.0 * np.array(level))
        added, impacting = rng.normal(size=12), rng.random(12) < 0.3 if rng.random() < 0.5 else None
        recent.add(number, added, impacting)
        mine = np.zeros(12, bool) if impacting is None else impacting
        steps.append(
            [(n, p) for n, p, own in zip(number, added, mine, strict=True) if not own and int(n) not in struck]
        )
        struck = set(number[mine].tolist())


def struck_bar(e, slow):
    """A bar at rest on a floor is struck at one end, and a little later more gently at the other."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((1.0, 0.2, 0.1), 2.0, position=(0, 0, 0.05), name="bar")
    scene.add_sphere(0.05, 0.5, position=(0.2, 0, 0.35), velocity=(0, 0, -6.0), name="hard")
    scene.add_sphere(0.05, 0.5, position=(-0.2, 0, 0.3), velocity=(0, 0, -slow), name="soft")
    return scene.build()


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("slow", [1.5, 2.0, 3.0])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_floor_that_was_struck_strongly_takes_part_in_the_next_impact(scheme, e, slow, compiled, monkeypatch):
    problem, h = struck_bar(e, slow), 2e-3
    if not compiled:
        monkeypatch.setattr(taking, "compiled_loop", lambda *args: None)
    run = mbvi.simulate(problem, scheme, step=h, duration=0.13, progress=False)
    strikes = [set(impact.constraints) for impact in run.impacts]
    assert {"bar | floor", "bar | hard"} in strikes and {"bar | floor", "bar | soft"} in strikes
    blows = [impact for impact in run.impacts if impact.percussion.max() > 0.5]
    assert len(blows) >= 2
    for impact in blows:
        names = np.array(impact.constraints)
        lift = np.where(names == "bar | floor", impact.percussion, -impact.percussion).sum()
        # the bar stays at rest: the floor balances the blow, and what weighs on it for one step
        assert lift == pytest.approx(2.0 * 9.81 * h, abs=0.02)
