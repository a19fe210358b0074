"""An observer: the height of the skin at chosen points."""

from tactile_fem.finger.deformation import SkinSurface


class SkinHeight:
    """Z of the skin, mm, at points given by their undeformed X and Y."""

    def __init__(self, finger, xy_mm):
        self.points = SkinSurface(finger, xy_mm)

    def __call__(self, seen):
        """Return the column of a step."""
        displacement_mm = seen.simulation.problem.order.gather(seen.state.u)
        return {"skin_height_mm": self.points.deformed_mm(displacement_mm)[:, 2]}
