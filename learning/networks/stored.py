"""Numbers and a JSON header in one safetensors file: written whole or not at all, read or refused in one line."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Self

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from physics.schema import InputError
from physics.whole import write_whole

SCHEMA = 1


@dataclass(frozen=True)
class StoredScales:
    """What a network sees and says is scaled by: tensors that stand in its file as scales.NAME."""

    @classmethod
    def of(cls, tensors: dict[str, Tensor], path: Path) -> Self:
        """Those of a file. Raises `InputError` where one is missing."""
        try:
            return cls(**{field.name: tensors[f"scales.{field.name}"] for field in fields(cls)})
        except KeyError as error:
            raise InputError(f"{path}: not a whole checkpoint: {error}") from None


def state_of(network: nn.Module, scales: StoredScales) -> dict[str, Tensor]:
    """What predicts, as tensors by name."""
    return ({f"weights.{name}": value for name, value in network.state_dict().items()}
            | {f"scales.{name}": value for name, value in vars(scales).items()})


def write_stored(path: Path, about: dict[str, Any], tensors: dict[str, Tensor]) -> None:
    """Write a whole file, or none. Raises OSError."""
    header = {"about": json.dumps({"schema": SCHEMA, **about})}
    write_whole(path, save({name: value.detach().cpu().contiguous() for name, value in tensors.items()}, header))


def read_stored(path: str | Path) -> tuple[dict[str, Any], dict[str, Tensor]]:
    """The header and the tensors of a file. Raises `InputError` in one line when it is missing, cut short, or something else."""
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such checkpoint")
    try:
        with safe_open(path, framework="pt") as file:
            about = json.loads((file.metadata() or {}).get("about", "{}"))
            if about.get("schema") != SCHEMA:
                raise InputError(f"{path}: checkpoint schema {about.get('schema')}, this program reads {SCHEMA}")
            return about, {name: file.get_tensor(name) for name in file.keys()}
    except (SafetensorError, ValueError, AttributeError, OSError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not a whole checkpoint: {str(error).splitlines()[0]}") from None


def put_into(network: nn.Module, weights: dict[str, Tensor], path: str | Path) -> None:
    """Put a file's weights into a network. Raises `InputError` when they belong to a different one."""
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        (_, first, *_) = str(error).splitlines()  # after the name of the network what is wrong, a line each
        raise InputError(f"{path}: its weights do not fit its config: {first.strip()}") from None


def under(prefix: str, tensors: dict[str, Tensor]) -> dict[str, Tensor]:
    """The tensors whose names begin so, without that beginning."""
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
