"""Ways into the command line beside its verbs: one example for each verb, the version, and what a shell needs to complete words."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from datagen.files.provenance import commit, release

EXAMPLES = {
    "modes": "press.toml --count 6 --out modes.vtu", "simulate": "press.toml --set obstacle.radius=0.012 --out press.vtkhdf",
    "generate": "demo --out data", "segment": "press.vtkhdf --segments 12 --picture segments.png",
    "train": "learning/configs/m4gn-small.toml --data data --out run --seconds 600", "calibrate": "run --data other",
    "rollout": "run press.vtkhdf --out p.vtkhdf",
    "sweep": "press.toml --vary obstacle.radius=0.0105:0.0125 --count 1000 --predictor assets/m4gn-fast --out sweep.h5",
    "evaluate": "run --data data --out report", "pareto": "press.toml --run run --predictor mymodule:model --out pareto",
    "verify": "p.vtkhdf --reference press.vtkhdf --out report", "view": "press.vtkhdf --out press.gif", "demo": "--out demo",
    "study": "main --size check --out study",
    "dataset check": "data --steps 5", "dataset stats": "data --refined 10", "dataset card": "data",
    "dataset pack": "data --tolerance 1e-6 --out data.pack", "dataset unpack": "data.pack --out data",
    "dataset import": "deforming_plate --out plate", "dataset export": "data --out records"}


class Version(argparse.Action):
    """Prints the version and, in a checkout, the commit."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        print(f"fidelity {release()}" + (f" ({commit()})" if commit() else ""))
        parser.exit()


class Completion(argparse.Action):
    """Prints what a shell needs to complete verbs, options and their choices."""

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        cases = "".join(f'    "{verb}") words="{words}";;\n' for verb, words in words_after(parser, ""))
        print("# bash: source <(fidelity --completion); zsh: autoload -U bashcompinit && bashcompinit before that\n"
              "_fidelity() {\n  local verb=${COMP_WORDS[1]} words\n  ((COMP_CWORD > 1)) || verb=\n"
              '  [[ $verb != dataset ]] || ((COMP_CWORD == 2)) || verb="dataset ${COMP_WORDS[2]}"\n'
              f'  case "$verb" in\n{cases}  esac\n'
              '  COMPREPLY=($(compgen -W "$words" -- "${COMP_WORDS[COMP_CWORD]}"))\n}\ncomplete -o default -F _fidelity fidelity ./run')
        parser.exit()


def words_after(parser: argparse.ArgumentParser, verb: str) -> Iterator[tuple[str, str]]:
    """Each verb with the words that may follow it."""
    words: list[str] = []
    for action in parser._actions:
        words += [*action.option_strings, *(action.choices or ())]
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from words_after(below, f"{verb} {name}".strip())
    yield verb, " ".join(words)
