"""Work spread over processes: on this machine, or on a Dask cluster.

On this machine each worker is a process with one thread, spawned rather than forked because MPI does not survive a fork,
and ended by the kernel when its parent is gone. On a cluster the workers are whatever its scheduler has, of one thread each.
"""

from __future__ import annotations

import asyncio
import ctypes
import logging
import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import CancelledError, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from tqdm import tqdm

from datagen.files.provenance import commit
from physics.schema import InputError

J = TypeVar("J")
R = TypeVar("R")
UNIT = " trajectories"
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


def progress(items: Iterable[J], what: str) -> Iterable[J]:
    """The same items, with a bar on standard error when that is a terminal."""
    return tqdm(items, desc=what, leave=False, disable=None)


def on_this_machine(function: Callable[[J], R], jobs: list[J], processes: int, *, kept: int = 0,
                    unit: str = UNIT) -> Iterator[tuple[J, R]]:
    """Each job with its result, as they come, by some processes; `kept` is how many were done before, `unit` what a bar counts.

    Raises:
        RuntimeError: a process was killed
        whatever the function raises
    """
    with (_one_thread(), _bar(kept, len(jobs), unit) as bar,
          ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"), _die_with_parent) as pool):
        with _without_main():
            futures = {pool.submit(function, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
                bar.update()
        except BrokenProcessPool:
            raise RuntimeError("a worker process was killed, perhaps for want of memory; fewer workers need less. What is "
                               "finished is kept: run the same again to go on") from None
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def on_cluster(function: Callable[[J], R], jobs: list[J], address: str, *, prepare: tuple[Callable[[Any], None], Any],
               folder: Path, kept: int = 0, tls: Sequence[str] = (), unit: str = UNIT) -> Iterator[tuple[J, R]]:
    """Each job with its result, as they come, by the workers of a Dask scheduler.

    A scheduler at tcp:// runs what anybody who reaches it sends: that is for a trusted network. At tls:// both sides show
    certificates of one authority.

    Args:
        prepare: a function and its argument, to be run once on each machine before anything else
        folder: a folder that every worker must see
        tls: files of the authority's certificate, of our own and of its key; for tls:// without them Dask's own settings hold
        unit: what a bar counts, if it shall

    Raises:
        InputError: there is no scheduler, its certificate or ours does not hold, it has no workers, they have several threads, or
            Dask is not installed
        RuntimeError: the folder is not seen, the workers' program is another one, or a worker was lost too often
    """
    try:
        from distributed import as_completed as completed
        from distributed.comm import CommClosedError
        from distributed.scheduler import KilledWorker
    except ImportError:
        raise InputError("--cluster needs the package distributed: pip install distributed") from None
    with _quiet(), _client(address, tls) as client, _bar(kept, len(jobs), unit) as bar:
        threads = client.nthreads()
        if not threads:
            raise InputError(f"--cluster {address}: no workers; start some with: dask worker {address} --nthreads 1")
        if max(threads.values()) > 1:
            raise InputError(f"--cluster {address}: workers with several threads; start them with --nthreads 1")
        one_each = {urlsplit(worker).hostname: worker for worker in threads}.values()
        ready = [client.submit(_ready, *prepare, folder, commit(), workers=[worker], pure=False) for worker in one_each]
        for future in ready:
            future.result()
        futures = dict(zip(client.map(function, jobs, pure=False), jobs, strict=True))
        try:
            for future in completed(futures, loop=client.loop):
                yield futures[future], future.result()
                bar.update()
        except KilledWorker:
            raise RuntimeError("workers of the cluster were lost again and again, perhaps for want of memory. What is finished "
                               "is kept: run the same again to go on") from None
        except (asyncio.CancelledError, CancelledError, CommClosedError):
            raise RuntimeError(f"the scheduler at {address} is gone. What is finished is kept: run the same again to go on") from None
        finally:
            if client.status == "running":
                client.cancel(list(futures))


def _client(address: str, tls: Sequence[str]) -> Any:
    """A client of a scheduler, with certificates where its address begins with tls://. Raises `InputError`."""
    from distributed import Client, Security

    how: dict[str, Any] = {}
    if tls and not address.startswith("tls://"):
        raise InputError(f"--cluster {address}: certificates are for an address that begins with tls://")
    if "://" not in address and not address.rpartition(":")[2].isdigit():
        raise InputError(f"--cluster {address}: must be the address of a Dask scheduler, such as tcp://host:8786")
    for file in tls:
        if not Path(file).is_file():
            raise InputError(f"--tls {file}: no such file")
    try:
        if address.startswith("tls://"):
            files = dict(zip(("tls_ca_file", "tls_client_cert", "tls_client_key"), tls, strict=False))
            how["security"] = Security(require_encryption=True, **files)
            if how["security"].get_connection_args("client").get("ssl_context") is None:  # reads the files
                raise InputError(f"--cluster {address}: needs certificates: --tls CA CERT KEY")
        return Client(address, timeout=10, set_as_default=False, **how)
    except InputError:
        raise
    except (OSError, ValueError, TypeError) as error:
        raise InputError(f"--cluster {address}: no Dask scheduler there: {' '.join(str(error).split())}") from None


@contextmanager
def _quiet() -> Iterator[None]:
    """No library logs inside: what is wrong ends in one line of ours, and Dask's own tracebacks would stand before it."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


def _ready(function: Callable[[Any], None], argument: Any, folder: Path, expected: str) -> None:
    """Run on one worker of each machine before the rest."""
    host = os.uname().nodename
    if not folder.is_dir():
        raise RuntimeError(f"the cluster's machine {host} does not see the folder {folder}; choose one on a shared file system")
    if commit() != expected:
        raise RuntimeError(f"the cluster's machine {host} runs commit {commit() or 'unknown'} of this program, not {expected}")
    function(argument)


def _bar(kept: int, more: int, unit: str = UNIT) -> tqdm[Any]:
    return tqdm(total=kept + more, initial=kept, unit=unit, disable=None if unit else True)


def _die_with_parent() -> None:
    """Have the kernel end this worker when its parent is gone, killed included (Linux: PR_SET_PDEATHSIG = 1)."""
    ctypes.CDLL(None).prctl(1, signal.SIGKILL)
    parent = multiprocessing.parent_process()
    if parent is None or os.getppid() != parent.pid:  # it was gone before the kernel knew
        os._exit(1)


@contextmanager
def _without_main() -> Iterator[None]:
    """Processes spawned inside do not run the user's script again, as they would to look for functions in it: ours are elsewhere."""
    main = sys.modules["__main__"]
    before = {name: main.__dict__.get(name) for name in ("__file__", "__spec__")}
    main.__dict__.update(dict.fromkeys(before))
    try:
        yield
    finally:
        main.__dict__.update(before)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started inside use one thread each."""
    before = {name: os.environ.get(name) for name in THREADS}
    os.environ.update(dict.fromkeys(THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name)
            if value is not None:
                os.environ[name] = value
