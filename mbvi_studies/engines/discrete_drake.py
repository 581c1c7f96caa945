"""Drake's discrete contact solvers, with stiffness and dissipation of contacts as delivered."""

from __future__ import annotations

from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, DiscreteContactApproximation
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

SETTING = "discrete steps, point contact of the delivered stiffness"


class DiscreteDrake:
    """A world without bodies; a derived class adds them to `plant` and calls `finalize`.

    Parameters
    ----------
    h : float
        Time step [s].
    approximation : DiscreteContactApproximation
        The contact solver.
    """

    def __init__(self, h: float, approximation: DiscreteContactApproximation) -> None:
        self._builder, self._h, self._taken = DiagramBuilder(), h, 0
        self.plant, _ = AddMultibodyPlantSceneGraph(self._builder, h)
        self.plant.set_contact_model(ContactModel.kPoint)
        self.plant.set_discrete_contact_approximation(approximation)

    def finalize(self) -> None:
        """Make the simulator and `context`, which holds the state."""
        self.plant.Finalize()
        self.simulator = Simulator(self._builder.Build())
        self.context = self.plant.GetMyMutableContextFromRoot(self.simulator.get_mutable_context())

    def advance(self) -> None:
        """Advance by one step."""
        self._taken += 1
        self.simulator.AdvanceTo(self._taken * self._h)
