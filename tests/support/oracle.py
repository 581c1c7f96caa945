"""One step of a robot written from docs/: numpy, Pinocchio's Python and a small QP that certifies its own answer.

Nothing here calls mbvi's schemes, projections, constraints or systems. Of a problem it reads data: Pinocchio's model,
shapes, half-spaces, restitution and friction; of a step the contact points, normals and tangents.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import null_space
from scipy.optimize import nnls

from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, Sphere


class Free(NamedTuple):
    """Where the law acts, M there, and the velocity x that forces alone lead to."""

    place: np.ndarray
    matrix: np.ndarray
    velocity: np.ndarray


class RobotOracle:
    """A robot over half-spaces, without control.

    M dv/dt = -nle(q, v) - D v. The step to x is implicit in D v, (M + h D) (x - v) = -h nle - h D v; the law acts on x
    in the metric M. With coupled joints, J_e v = 0, both hold on ker J_e: `basis`, shape (nv, r), spans it.
    """

    def __init__(self, problem):
        self.problem, self.model = problem, problem.model()
        self.data = self.model.createData()
        self.damping = np.diag(np.array(self.model.damping))
        self.walls = {name: (np.array(w.normal), w.offset) for name, w in problem.scene.walls.items()}
        self.shapes = {shape.name: shape for shape in problem.scene.shapes}
        # followers and leaders among the joints, ratios and offsets; those of a fixed leader are left to other tests
        joint = {f"{problem.system.name}/{name}": k for k, name in enumerate(self.model.names)}
        couplings = problem.scene.items.couplings
        self.couplings = [(joint[c.first], joint[c.second], c.ratio, c.offset) for c in couplings]
        rows = np.zeros((len(couplings), self.model.nv))
        for row, (first, second, ratio, _) in zip(rows, self.couplings, strict=True):
            row[self.model.idx_vs[first]], row[self.model.idx_vs[second]] = 1.0, -ratio
        self.basis = null_space(rows) if couplings else np.eye(self.model.nv)

    def matrix(self, q):
        upper = np.triu(pin.crba(self.model, self.data, q))
        return upper + np.triu(upper, 1).T

    def free(self, q, v, h, forces_at=None):
        """x at a place, from v, with forces of another velocity."""
        M, u = self.matrix(q), v if forces_at is None else forces_at
        effective = M + h * self.damping
        effects = pin.nonLinearEffects(self.model, self.data, q, u) + self.damping @ u
        x, N = v - h * np.linalg.solve(effective, effects), self.basis
        return Free(q, M, N @ np.linalg.solve(N.T @ effective @ N, N.T @ effective @ x) if self.couplings else x)

    def project(self, free, J, lower):
        """The velocity of the law on ker J_e."""
        N = self.basis
        y = np.linalg.lstsq(N, free.velocity)[0] if self.couplings else free.velocity
        return N @ projection(N.T @ free.matrix @ N, y, J @ N, lower)[0]

    def follow(self, q, v):
        """Place joints where those that they follow lead them, and move them so."""
        k, i = self.model.idx_qs, self.model.idx_vs
        for _ in self.couplings:
            for first, second, ratio, offset in self.couplings:
                q[k[first]], v[i[first]] = ratio * q[k[second]] + offset, ratio * v[i[second]]

    # where the schemes of docs/howto/schemes.md apply the law, and what they move before and after it
    def paoli(self, q, v, h):
        return self.free(pin.integrate(self.model, q, h * v), v, h)

    def moreau_jean(self, q, v, h, theta=0.5):
        return self.free(pin.integrate(self.model, q, (1.0 - theta) * h * v), v, h)

    def centered(self, q, v, h):
        """Forces at v + h M^-1 g / 2; for robots without damping."""
        assert not self.damping.any()
        middle = pin.integrate(self.model, q, 0.5 * h * v)
        return self.free(middle, v, h, 0.5 * (v + self.free(middle, v, h).velocity))

    def stewart_trinkle(self, q, v, h):
        return self.free(q, v, h)

    def row(self, q, name, point, normal):
        """Gradient of a constraint by its name; of a contact from its point and normal [n, p x n]."""
        if name.endswith(" limit"):
            joint, kind = name.rpartition("/")[2].removesuffix(" limit").rsplit(" ", 1)
            row = np.zeros(self.model.nv)
            row[self.model.joints[self.model.getJointId(joint)].idx_v] = {"lower": 1.0, "upper": -1.0}[kind]
            return row
        return normal @ self.relative(q, name, point)

    def relative(self, q, name, point):
        """Velocity of the second body relative to the first at a point, shape (3, nv)."""
        first, second = self.bodies(name)
        return self.at_point(q, second, point) - self.at_point(q, first, point)

    def bodies(self, name):
        """Bodies of a contact such that the normal points from the first to the second: a wall is always the first."""
        first, second = name.split(" | ")
        if second in self.walls:
            return 0, self.shapes[first].body
        return self.shapes[first].body, self.shapes[second].body

    def at_point(self, q, body, point):
        """Velocity of the point of a body that is at a point of the world, shape (3, nv)."""
        if not body:
            return np.zeros((3, self.model.nv))
        whole = pin.computeJointJacobians(self.model, self.data, q)
        assert whole is not None
        jacobian = pin.getJointJacobian(self.model, self.data, body, pin.WORLD)
        return jacobian[:3] - pin.skew(np.asarray(point)) @ jacobian[3:]

    def gaps(self, q):
        """Gaps of joint limits and of shapes to half-spaces by name, the least one of each [m, rad]."""
        found = {}
        for joint in range(1, self.model.njoints):
            if self.model.nqs[joint] != 1:
                continue
            k, name = self.model.idx_qs[joint], self.model.names[joint]
            lower, upper = self.model.lowerPositionLimit[k], self.model.upperPositionLimit[k]
            prefix = next(iter(self.shapes)).partition("/")[0]
            if np.isfinite(lower) and lower > -1e100:
                found[f"{prefix}/{name} lower limit"] = q[k] - lower
            if np.isfinite(upper) and upper < 1e100:
                found[f"{prefix}/{name} upper limit"] = upper - q[k]
        pin.forwardKinematics(self.model, self.data, q)
        for shape in self.shapes.values():
            place = self.data.oMi[shape.body] if shape.body else pin.SE3.Identity()
            centre, turn = place.act(np.array(shape.position)), place.rotation @ shape.rotation
            for wall, (normal, offset) in self.walls.items():
                low = lowest(shape.shape, turn.T @ normal)
                found[f"{shape.name} | {wall}"] = float(normal @ centre) - offset + low
        return found


def lowest(shape, normal):
    """The least n . x over the points x of a shape, in its own frame."""
    if isinstance(shape, Sphere):
        return -shape.radius
    if isinstance(shape, Ellipsoid):
        return -float(np.linalg.norm(np.array(shape.radii) * normal))
    if isinstance(shape, Capsule):
        return -shape.radius - 0.5 * shape.length * abs(normal[2])
    if isinstance(shape, Cylinder):
        return -shape.radius * float(np.hypot(normal[0], normal[1])) - 0.5 * shape.length * abs(normal[2])
    if isinstance(shape, Box):
        return -0.5 * float(np.abs(normal) @ np.array(shape.size))
    assert isinstance(shape, Hull)
    return float((shape.vertices @ normal).min())


def projection(M, x, J, lower):
    """Return argmin |w - x|_M under J w >= lower, and p >= 0 with M (w - x) = J' p, by Lawson's and Hanson's NNLS.

    With y = L'(w - x) it is the least y with A' y >= d. The answer is checked against the KKT conditions.
    """
    if not len(J):
        return x, np.zeros(0)
    L = np.linalg.cholesky(M)
    A = np.linalg.solve(L, J.T)
    size = np.linalg.norm(A, axis=0)
    A, d = A / size, (lower - J @ x) / size
    scale = max(1.0, float(np.abs(d).max()))
    u, _ = nnls(np.vstack([A, d / scale]), np.append(np.zeros(len(A)), 1.0), maxiter=60 * len(d))
    found = []
    for least in (1e-12, 1e-9, 1e-7):
        support = u > least * max(u.max(), 1e-300)
        p = np.zeros(len(d))
        for _ in range(len(d) + 1):
            p[:] = 0.0
            p[support] = np.linalg.lstsq(A[:, support], np.linalg.pinv(A[:, support].T) @ d[support], rcond=1e-13)[0]
            if not (p < -1e-11 * scale).any():
                break
            support &= p > 0.0
        p = np.maximum(p, 0.0)
        slack = A.T @ (A @ p) - d
        found.append((max(-slack.min(), np.abs(p * slack).max() / max(p.max(), 1e-300)), p))
    worst, p = min(found, key=lambda pair: pair[0])
    if worst > 1e-9 * scale:
        raise ArithmeticError(f"the oracle did not solve its own projection: {worst:.1e}")
    return x + np.linalg.solve(L.T, A @ p), p / size
