"""A cluster that measures folders: a Dask scheduler's address, and workers that see the same archive."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from concurrent.futures import CancelledError
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from alignment.errors import ConfigurationError, told
from station.replay.values import Choices, Job, Replayed, ReplayState
from station.store import CODE, environment

if TYPE_CHECKING:
    from distributed import Client

    from station.replay.one import Measurer

_ADDRESS = re.compile(r"(?:tcp|tls)://[^\s/:]+:\d{1,5}|(?:tcp|tls)://\[[0-9A-Fa-f:]+\]:\d{1,5}")
_CONNECT_S, _ASK_S = 15.0, 120.0
_WAITING_FOR_EACH, _FEWEST_WAITING = 3, 8
_RETRIES = 2
_LOOK_S, _WITHOUT_WORKERS_S = 5.0, 60.0
_MOST_NAMED = 5
_SCHEDULER = "scheduler"


def measure_on_cluster(
    jobs: Iterator[Job], choices: Choices, address: str, archive: Path
) -> Iterator[Replayed]:
    """Yield what came of folders, in the order in which they are done.

    Parameters
    ----------
    jobs
        Taken as there is room: few are in memory at once.
    choices
        For all of them.
    address
        Of the scheduler: ``tcp://HOST:PORT``.
    archive
        Its absolute path; workers must see it at the same one.

    Raises
    ------
    ConfigurationError
        When Dask is not installed here, the address is none, nobody answers there, it has no worker, or one
        of them runs another program or does not see the archive.
    """
    if _ADDRESS.fullmatch(address) is None:
        raise ConfigurationError(
            choice=_SCHEDULER, expected="an address such as tcp://127.0.0.1:8786", seen=f"'{address}'"
        )
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigurationError(
            choice=_SCHEDULER,
            expected="the package distributed for work on a cluster",
            seen=told(error),
            cure="Install truewheel with its extra: pip install 'truewheel[cluster]'",
        ) from error
    try:
        client = Client(address, timeout=_CONNECT_S)
    except (OSError, TimeoutError, ValueError) as error:
        raise ConfigurationError(
            choice=_SCHEDULER,
            expected=f"a Dask scheduler at {address}",
            seen=told(error),
            cure="Start one with `dask scheduler`, and workers with `dask worker ADDRESS`",
        ) from error
    with client:
        yield from _measured(client, jobs, choices, archive)


def _measured(client: Client, jobs: Iterator[Job], choices: Choices, archive: Path) -> Iterator[Replayed]:
    threads = _require_workers(client, archive)
    # To every worker once, and not with every folder.
    shared = client.scatter(choices, broadcast=True, hash=False)
    most = max(_FEWEST_WAITING, _WAITING_FOR_EACH * threads)
    running: dict[Any, Job] = {}
    while True:
        while len(running) < most and (job := next(jobs, None)) is not None:
            future = client.submit(measure_here, job, shared, str(archive), pure=False, retries=_RETRIES)
            running[future] = job
        if not running:
            return
        for future in _done(client, running):
            yield _result(client, future, running.pop(future))


def _done(client: Client, running: Mapping[Any, Job]) -> list[Any]:
    """Wait for some of what is under way; as long as there are workers it may take its time."""
    from distributed import wait

    without_s = 0.0
    while without_s < _WITHOUT_WORKERS_S:
        try:
            return list(wait(list(running), timeout=_LOOK_S, return_when="FIRST_COMPLETED").done)
        except TimeoutError:
            alive = client.status == "running" and client.scheduler_info(n_workers=-1)["workers"]
            without_s = 0.0 if alive else without_s + _LOOK_S
        except CancelledError:
            break
    raise _lost(client)


def _result(client: Client, future: Any, job: Job) -> Replayed:
    try:
        found = future.result()
    except ArchiveUnseenError as error:
        raise _unfit(
            "workers that see the archive at the same path as this computer",
            str(error),
            "Share the folder among all of them",
        ) from error
    except Exception as error:
        if client.status != "running" or isinstance(error, CancelledError):
            raise _lost(client) from error
        # A worker that ends again and again, or cannot read what it was sent.
        return Replayed(job.key, ReplayState.FAILED, lacks=(f"the cluster gave it up: {told(error)}",))
    finally:
        future.release()
    return found if isinstance(found, Replayed) else Replayed(job.key, ReplayState.FAILED)


def _lost(client: Client) -> ConfigurationError:
    return _unfit(
        "a scheduler with workers until the end",
        f"none any more ({client.status})",
        "Start them again; the same replay goes on where it stopped",
    )


class ArchiveUnseenError(Exception):
    """A worker has no such folder: nothing is said of the images."""


_OWN: dict[int, Measurer] = {}
"""Of a worker: that of the choices it was given last."""


def measure_here(job: Job, choices: Choices, archive: str) -> Replayed:
    """Measure one folder in a worker of the cluster."""
    if not Path(archive).is_dir():
        raise ArchiveUnseenError(f"no folder {archive} on {_host()}")
    if id(choices) not in _OWN:
        from station.replay.one import Measurer

        _OWN.clear()
        # Kept with its choices, so that nothing else gets their place in memory.
        _OWN[id(choices)] = Measurer(choices)
    return _OWN[id(choices)].replay(job)


def identity_here(archive: str) -> dict[str, Any]:
    """Return what a worker is: its program, and whether it sees the archive."""
    return {
        "version": version("truewheel"),
        "code": environment()[CODE],
        "sees": Path(archive).is_dir(),
        "host": _host(),
    }


def _host() -> str:
    import platform

    return platform.node() or "a computer without name"


def _require_workers(client: Client, archive: Path) -> int:
    """Return how many threads the workers have together, after asking each of them what it is."""
    known: Mapping[str, Any] = client.scheduler_info(n_workers=-1)["workers"]
    if not known:
        raise _unfit("at least one worker", "none", "Start some with `dask worker ADDRESS`")
    try:
        found = client.run(identity_here, str(archive), on_error="return", wait=True)
    except Exception as error:
        raise _unfit("workers that answer", told(error), "Look at their logs") from error
    mine = identity_here(str(archive))
    failed = {name: told(one) for name, one in found.items() if isinstance(one, BaseException)}
    if failed:
        text = "; ".join(f"{name}: {what}" for name, what in list(failed.items())[:_MOST_NAMED])
        raise _unfit(
            "workers on which truewheel is installed", text, "Install this version of it on all of them"
        )
    for what, wrong, cure in (
        (
            f"workers with truewheel {mine['version']} as it is here",
            [
                name
                for name, one in found.items()
                if any(one[key] != mine[key] for key in ("version", "code"))
            ],
            "Install this version of it on all of them",
        ),
        (
            f"workers that see {archive}",
            [name for name, one in found.items() if not one["sees"]],
            "Share the folder among all of them, at the same path",
        ),
    ):
        if wrong:
            named = ", ".join(wrong[:_MOST_NAMED]) + (" and more" if len(wrong) > _MOST_NAMED else "")
            raise _unfit(what, f"{len(wrong)} others: {named}", cure)
    return sum(int(each["nthreads"]) for each in known.values())


def _unfit(expected: str, seen: str, cure: str) -> ConfigurationError:
    return ConfigurationError(choice=_SCHEDULER, expected=expected, seen=seen, cure=cure)
