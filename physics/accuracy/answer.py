"""The answer to a scene that asks for an error: its mesh and steps are chosen, the whole scene is solved, and its error is judged."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from physics.accuracy.between import solve_chosen
from physics.accuracy.choose import choose
from physics.accuracy.motion import choose_motion
from physics.accuracy.table import Verdict, judge
from physics.scene import Scene
from physics.solution import Solution


def answer(scene: Scene, *, on_step: Callable[[int], None] | None = None, journal: Callable[[Scene], Path] | None = None,
           balanced: bool = False, snaps: bool = True) -> tuple[Scene, Solution, Verdict | None]:
    """The scene as it was chosen, its path or what was reached of it, and what is known of its error, if its end was reached.

    Args:
        on_step: called with the number of each step that is reached
        journal: gives for the chosen scene a file to keep its path in as in `solve`, or refuses it; that of a motion is kept in none
        balanced, snaps: as in `solve_chosen`; of equilibria

    Raises as `choose`.
    """
    if scene.steps.dynamic:
        motion = choose_motion(scene)
        if journal is not None:
            journal(motion.scene)
        if on_step is not None:
            on_step(scene.steps.count)
        return motion.scene, motion.solution, motion.verdict
    choice = choose(scene, balanced=balanced)
    solution = solve_chosen(choice, on_step=on_step, journal=None if journal is None else journal(choice.scene), partial=True,
                            balanced=balanced, snaps=snaps)
    return choice.scene, solution, None if solution.failure else judge(choice, solution)
