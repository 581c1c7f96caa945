"""The part of a scene that adds controls of the whole scene and external forces."""

from __future__ import annotations

from ...arguments import function, shown
from ...errors import InputError
from ..items import Force, ForceItem, SceneControl, SceneItems

# most names that an error lists
_MOST_NAMED = 50


class Actions:
    """Methods of `Scene` that add controls of the whole scene, and external forces."""

    _items: SceneItems

    def add_control(self, control: SceneControl) -> None:
        """Add a control that sees the whole scene; several add up, and with the robots' own.

        Parameters
        ----------
        control : callable
            control(state) -> {robot: tau}, tau of shape (nv,) [N, N m] as that robot's own control returns it; None or
            {} act on none. `state.t` is the time [s], `state.q[name]` and `state.v[name]` are those of each robot, body
            and sphere that moves, `state.contacts` are the contacts of the last accepted step: see
            `mbvi.scene.state.State`.

        Raises
        ------
        InputError
            If it is no function of one argument; in a step, if it names an unknown robot or returns torques of a wrong
            shape or that are not finite.
        """
        self._items.controls.append(function(control, "control", "control(state) -> {robot: tau}"))

    def add_force(self, body: str, force: Force) -> None:
        """Add an external force and moment at the centre of mass of a body; several on one body add up.

        Parameters
        ----------
        body : str
            A rigid body, a sphere, a robot's link "robot/link", or a group of bodies or spheres under one name or one
            of its members, "spheres[3]".
        force : callable
            force(t, q, v) -> shape (6,): force [N], then moment [N m], in the world. q and v are the body's own, as
            `state.q` and `state.v` of `add_control` have them; of a link they are its robot's. A group of n gives
            arrays of n rows and takes (n, 6). Spheres have no rotation: (3,) and (n, 3) do for them, and a moment that
            is not zero is an error. Of a link without mass the force acts at its frame's origin.

        Raises
        ------
        InputError
            If nothing of that name moves, or `force` is no function; in a step, if it returns a wrong shape, numbers
            that are not finite, or, in a planar scene, a force or moment that leaves the plane.
        """
        form = function(force, "force", "force(t, q, v) -> (6,)")
        self._items.forces.append(ForceItem(self._checked_target(body), form))

    def _checked_target(self, body: str) -> str:
        items = self._items
        bodies = {b.name: not b.fixed for b in items.bodies}
        spheres = [n for s in items.spheres for n in s.names()]
        links = {link: moves for robot in items.robots for link, moves in robot.links().items()}
        groups = dict.fromkeys([n.partition("[")[0] for n in bodies if bodies[n]] + [s.name for s in items.spheres])
        moving = [*groups, *(link for link in links if links[link])]
        if not isinstance(body, str):
            raise InputError(f"body must be a name; got {shown(body)}")
        if body in moving or body in spheres or bodies.get(body):
            return body
        of_it = [link for link in moving if link.startswith(f"{body}/")]
        if of_it:
            raise InputError(f"{body} is a robot; name one of its links: {', '.join(of_it[:_MOST_NAMED])}")
        fixed = body in links or body in bodies or body in items.names() | items.parts()
        why = "is part of the world, which no force moves" if fixed else "is no body of this scene"
        raise InputError(f"{shown(body)} {why}; those that move are {', '.join(moving[:_MOST_NAMED]) or 'none yet'}")
