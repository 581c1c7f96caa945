"""All stress scenes, in the order of the table."""

from .bodies import BODIES
from .friction import FRICTION
from .mechanisms import MECHANISMS
from .scene import StressScene

SCENES: tuple[StressScene, ...] = (*BODIES, *MECHANISMS, *FRICTION)
