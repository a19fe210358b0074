# %% [markdown]
# # The cost of a held force
#
# This benchmark emphasizes
# - what a slide at a held normal force costs compared with one at a held depth,
# - how exactly the force is held, and how the body moves up and down.
#
# At a held force the body's height is found by the secant method around Newton's method. Each
# further solve starts from the last one. The first guess extrapolates the last step.
#
#     python demos/benchmarks/held_force.py
#     mpirun -n 2 python demos/benchmarks/held_force.py --distance 2
#     python demos/benchmarks/held_force.py --distance 0.2 --pad-size 3 --far-size 6   # small

# %%
from tactile_fem import Study, run_script, scan
from tactile_fem.study import Finger, Protocol

from mpi4py import MPI  # isort: skip  (after DOLFINx, which orders MPI)


# %%
def main(
    *,
    force: float = 0.4,
    distance: float = 2.0,
    pad_size: float | None = None,
    far_size: float | None = None,
) -> None:
    """Press the letters to a force, slide at the depth or at the force, and compare."""
    rank = MPI.COMM_WORLD.rank
    finger = Finger(pad_size_mm=pad_size, far_size_mm=far_size)
    if rank == 0:
        print("held   steps  solves  Newton  linear    s  force N          depth mm")
    for hold in ("depth", "force"):
        protocol = Protocol(force_N=force, hold=hold, distance_mm=distance)
        slide = slide_of(Study(finger=finger, protocol=protocol))
        if rank == 0:
            print_row(hold, slide)


# %%
def slide_of(study: Study) -> list:
    """Return the steps of the slide."""
    steps = []
    scan(study, observers=[lambda seen: steps.append(seen.step)])
    return [step for step in steps if step.phase == "slide"]


# %%
def print_row(hold: str, slide: list) -> None:
    """Print the cost and the range of force and depth."""
    solves = sum(1 + len(step.discarded) for step in slide)
    newton = sum(step.newton_iterations for step in slide)
    linear = sum(step.linear_iterations for step in slide)
    seconds = sum(step.wall_s for step in slide)
    force = [step.force_N[2] for step in slide]
    depth = [step.depth_mm for step in slide]
    print(
        f"{hold}  {len(slide):6d} {solves:7d} {newton:7d} {linear:7d} {seconds:5.0f}"
        f"  {min(force):.4f}-{max(force):.4f}  {min(depth):.3f}-{max(depth):.3f}"
    )


# %%
if __name__ == "__main__":
    run_script(main)
