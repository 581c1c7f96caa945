"""The bound from a separating axis: never more than Coal's distance, and that distance where the axis is its normal."""

from itertools import combinations_with_replacement

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mbvi
from mbvi.constraints import SignedDistances
from mbvi.geometry.broad.separating_axis import SeparatingAxes
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from mbvi.projection import Projector
from support.paths import ROBOTS

KINDS = {
    "sphere": lambda r: Sphere(r()),
    "ellipsoid": lambda r: Ellipsoid((r(), r(), r())),
    "box": lambda r: Box((r(), r(), r())),
    "hull": lambda r: Hull(np.array([[r(), 0, 0], [-r(), 0, 0.1], [0, r(), 0], [0.1, -r(), 0], [0, 0, r()]])),
    "capsule": lambda r: Capsule(r(), r()),
    "cylinder": lambda r: Cylinder(r(), r()),
}  # fmt: skip
LEGS = ("FL", "FR", "RL", "RR")
every_pair = pytest.mark.parametrize(("first", "second"), [*combinations_with_replacement(KINDS, 2)])
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(autouse=True, scope="module")
def kernels():
    """Everything here is of the compiled forms."""
    Projector()


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def unit(rng):
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def shape(kind, rng):
    return KINDS[kind](lambda: rng.uniform(0.05, 0.5))


class Pair:
    """Two placed shapes in either order on two bodies, of which one may be the world, and where they are."""

    def __init__(self, first, second, rng, apart):
        world = int(rng.integers(3))
        owners = [0 if world == 1 else 1, 0 if world == 2 else 2]
        self.placed = [
            PlacedShape(name, shape(kind, rng), body, rotation(rng), 0.1 * rng.normal(size=3))
            for name, kind, body in zip("ab", rng.permutation([first, second]).tolist(), owners, strict=True)
        ]
        self.axes = SeparatingAxes(ShapeTable(self.placed), np.array([[0, 1]]))
        self.places = np.array([[*rotation(rng), rng.normal(size=3) * apart] for _ in self.axes.bodies])

    def pose(self, side):
        placed, frame = self.placed[side], self.axes.frame[side]
        if frame < 0:
            return coal.Transform3s(placed.rotation, placed.position)
        R = self.places[frame, :3].T
        return coal.Transform3s(R @ placed.rotation, R @ placed.position + self.places[frame, 3])

    def coal(self, accuracy=1e-9):
        """Coal's signed distance and its normal."""
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = request.epa_tolerance = accuracy
        a, b = (placed.shape.coal() for placed in self.placed)
        distance = coal.distance(a, self.pose(0), b, self.pose(1), request, result)
        return distance, np.array(result.normal)

    def depth(self):
        """Coal's signed distance of what overlaps: of two answers the deeper one is wrong."""
        return max(self.coal()[0], self.coal(1e-6)[0])

    def reach(self, side, u):
        """How far a shape reaches along u: Coal's distance of a half-space that looks along -u."""
        wall, geometry = coal.Halfspace(-u, 0.0), self.placed[side].shape.coal()
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        return -coal.distance(wall, coal.Transform3s.Identity(), geometry, self.pose(side), request, result)

    def keep(self, axis):
        self.axes.keep(self.places, np.array([0]), axis[None])

    def clear(self, tolerance):
        """Whether the pair is still to be asked, and its budget, NaN if nothing was written."""
        budget = np.full(1, np.nan)
        asked = self.axes.clear(self.places, np.array([0]), tolerance, budget)
        return len(asked) == 1, float(budget[0])

    def bound(self):
        asked, bound = self.clear(-np.inf)
        assert not asked
        return bound


@every_pair
def test_no_axis_promises_more_than_the_distance(first, second):
    # where a ball's centre is inside a cylinder Coal's closed form is not the least depth
    depth_known = {first, second} != {"sphere", "cylinder"}
    apart = overlapping = 0

    @given(seeds)
    def law(seed):
        nonlocal apart, overlapping
        rng = np.random.default_rng(seed)
        pair = Pair(first, second, rng, rng.choice([0.2, 1.0]))
        distance, _ = pair.coal()
        apart, overlapping = apart + (distance > 0.0), overlapping + (distance < 0.0)
        if distance < 0.0:
            distance = pair.depth() if depth_known else 0.0
        for _ in range(3):
            pair.keep(unit(rng))
            assert pair.bound() <= distance + 1e-9

    law()
    assert min(apart, overlapping) > 5


@every_pair
def test_coals_own_normal_gives_the_distance_of_what_is_apart(first, second):
    compared = 0

    @given(seeds)
    def law(seed):
        nonlocal compared
        pair = Pair(first, second, np.random.default_rng(seed), 1.0)
        distance, normal = pair.coal()
        if distance > 0.0:
            pair.keep(normal)
            assert pair.bound() == pytest.approx(distance, abs=1e-6)
            compared += 1

    law()
    assert compared > 20


@every_pair
def test_the_bound_is_the_gap_between_two_shadows(first, second):
    """Against Coal's half-spaces, which touch a shape where it reaches farthest."""
    rng = np.random.default_rng(7)
    for _ in range(10):
        pair, n = Pair(first, second, rng, 1.0), unit(rng)
        pair.keep(n)
        assert pair.bound() == pytest.approx(-pair.reach(1, -n) - pair.reach(0, n), abs=1e-12)


def test_an_axis_is_carried_along_by_the_first_body():
    """What both bodies do together changes nothing, and what the second does alone changes the bound as it moves."""
    rng = np.random.default_rng(8)
    for first in KINDS:
        pair = Pair(first, "hull", rng, 1.0)
        n = unit(rng)
        pair.keep(n)
        before, places = pair.bound(), pair.places.copy()
        if (pair.axes.frame >= 0).all():
            R, shift = rotation(rng), rng.normal(size=3)
            pair.places = places @ R.T
            pair.places[:, 3] += shift
            assert pair.bound() == pytest.approx(before, abs=1e-12)
            pair.places = places.copy()
        second = pair.axes.frame[1]
        if second >= 0:
            pair.places[second, 3] += 0.3 * n
            assert pair.bound() == pytest.approx(before + 0.3, abs=1e-12)


@every_pair
def test_a_pair_that_is_cleared_gets_the_bound_as_its_budget_and_no_other_is_written(first, second):
    rng = np.random.default_rng(9)
    for _ in range(5):
        pair = Pair(first, second, rng, 1.0)
        pair.keep(unit(rng))
        bound = pair.bound()
        for tolerance in (bound - 1e-6, bound, bound + 1e-6):
            asked, budget = pair.clear(tolerance)
            assert asked == (tolerance >= bound)
            np.testing.assert_equal(budget, np.nan if asked else bound)


@every_pair
def test_a_first_axis_is_kept_only_where_it_separates(first, second):
    answers = set()

    @given(seeds)
    def law(seed):
        rng = np.random.default_rng(seed)
        pair = Pair(first, second, rng, rng.choice([0.2, 1.0, 10.0]))
        asked, bound = pair.clear(0.0)
        answers.add(asked)
        assert asked == np.isnan(bound) == np.isnan(pair.axes.axis).all()
        if not asked:
            assert 0.0 < bound <= pair.coal()[0] + 1e-9
            assert np.linalg.norm(pair.axes.axis) == pytest.approx(1.0)
            assert pair.bound() == pytest.approx(bound, rel=1e-12)

    law()
    assert answers == {True, False}


@pytest.mark.parametrize("kinds", [("box", "cylinder"), ("cylinder", "box")])
def test_a_large_face_beside_a_small_shape_separates_at_once(kinds):
    """The direction between the centres does not."""
    shapes = {"box": Box((10.0, 10.0, 0.2)), "cylinder": Cylinder(0.1, 0.2)}
    placed = [PlacedShape(kind, shapes[kind], k + 1, np.eye(3), np.zeros(3)) for k, kind in enumerate(kinds)]
    axes, bound = SeparatingAxes(ShapeTable(placed), np.array([[0, 1]])), np.empty(1)
    where = {"box": np.zeros(3), "cylinder": np.array([4.0, 3.0, 0.5])}
    turn = rotation(np.random.default_rng(3))
    places = np.array([[*turn.T, turn @ where[kind]] for kind in kinds])
    assert not axes.clear(places, np.array([0]), 0.0, bound).size
    assert bound[0] == pytest.approx(0.3, abs=1e-12)


def test_shapes_with_the_same_centre_have_no_first_axis():
    placed = [PlacedShape(f"{k}", Box((1.0, 1.0, 1.0)), k + 1, np.eye(3), np.zeros(3)) for k in range(2)]
    axes, bound = SeparatingAxes(ShapeTable(placed), np.array([[0, 1]])), np.full(1, np.nan)
    places = np.array([[*np.eye(3), np.ones(3)]] * 2)
    assert axes.clear(places, np.array([0]), 0.0, bound).tolist() == [0]
    assert np.isnan(axes.axis).all()
    assert np.isnan(bound).all()


def test_of_many_pairs_those_that_are_due_and_not_cleared_are_asked_in_order():
    rng = np.random.default_rng(11)
    placed = [PlacedShape(kind, shape(kind, rng), k, rotation(rng), np.zeros(3)) for k, kind in enumerate(KINDS)]
    sides = np.array([(a, b) for a in range(6) for b in range(a)])
    axes = SeparatingAxes(ShapeTable(placed), sides)
    places = np.array([[*rotation(rng), 0.5 * rng.normal(size=3)] for _ in axes.bodies])
    known = np.flatnonzero(rng.random(len(sides)) < 0.8)
    axes.keep(places, known, np.array([unit(rng) for _ in known]))
    bounds = np.full(len(sides), np.nan)
    # the first call finds the missing axes, the second the bounds along them
    for _ in range(2):
        assert not axes.clear(places, np.arange(len(sides)), -np.inf, bounds).size
    due = np.sort(rng.choice(len(sides), 10, replace=False))
    budget = np.full(len(sides), -7.0)
    tolerance = float(np.nanmedian(bounds[due]))
    asked = axes.clear(places, due, tolerance, budget)
    cleared = [k for k in due if bounds[k] > tolerance]
    assert cleared
    np.testing.assert_array_equal(asked, [k for k in due if k not in cleared])
    np.testing.assert_array_equal(budget, [bounds[k] if k in cleared else -7.0 for k in range(len(sides))])


def test_what_the_axes_clear_while_legs_flail_is_never_active():
    """A quadruped folds its legs over each other; every pair is measured afresh at every step by another problem."""

    def flailing():
        rng = np.random.default_rng(15)
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.9)
        rates = {f"{leg}_{joint}_joint": 12.0 * rng.normal() for leg in LEGS for joint in ("hip", "thigh", "calf")}
        scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", velocity=rates)
        return scene.build()

    problem, afresh = flailing(), flailing()
    ours, other = (
        next(c for c in p.constraints.constraints if isinstance(c, SignedDistances)) for p in (problem, afresh)
    )
    every, tolerance = np.arange(len(other.names)), problem.tolerance
    due = cleared = touching = 0
    promised = {}
    clear = ours._axes.clear

    def noted(places, pairs, tolerance, budget):
        nonlocal due, cleared
        asked = clear(places, pairs, tolerance, budget)
        # lower bounds on the way of a step are no promise for its end
        if budget is ours._bounds:
            return asked
        kept = np.setdiff1d(pairs, asked)
        # a step that is cut is taken anew: what counts is the last
        promised.clear()
        promised.update(zip(kept.tolist(), budget[kept].tolist(), strict=True))
        due, cleared = due + len(pairs), cleared + len(kept)
        return asked

    ours._axes.clear = noted
    for k, step in enumerate(mbvi.steps(problem, mbvi.Paoli(), step=1e-3)):
        found = other.measure(step.q, every, tolerance)
        least = np.full(len(every), np.inf)
        np.minimum.at(least, found.pair, found.gap)
        expected = {other.names[pair] for pair in np.flatnonzero(least <= tolerance)}
        names = {problem.constraints.name(number) for number in step.active.constraint.tolist()}
        assert names & set(other.names) == expected
        assert all(bound <= least[pair] + 1e-9 for pair, bound in promised.items())
        promised.clear()
        touching += len(expected)
        if k == 1000:
            break
    assert touching > 5
    assert 0.5 * due < cleared
