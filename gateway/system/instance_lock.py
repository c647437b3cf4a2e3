"""One running gateway for one state directory.

The lock is a `flock` on a file there. The kernel releases it with the process however that ends, also across
containers that share the folder; the file itself stays. Programs that only read the folder need no lock.
"""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from gateway.errors import StartError

FILE = "gateway.lock"

_MOST_BYTES = 300  # of the file: a process id and a host's name
_NOT_PERMITTED = frozenset({errno.EACCES, errno.EPERM})

log = logging.getLogger(__name__)


def may_use(port: str, state_dir: Path) -> bool:
    """Return whether a port is free of the gateway with this folder; one across a network has no other lock.

    A serial server may take several clients: frames of two would meet on the line, a stop among them.
    """
    return not is_locked(state_dir, if_unseen="://" in port)


@contextmanager
def instance_lock(state_dir: Path) -> Iterator[None]:
    """Hold the folder's lock, made if need be; StartError when another process has it, or this user may not.

    Other trouble with the disk (full, no locks) is logged and prevents nothing: the starters are
    watched without a lock rather than not at all.
    """
    descriptor = _open(state_dir)
    try:
        if descriptor is not None:
            _lock(descriptor, state_dir)
        yield
    finally:
        if descriptor is not None:
            os.close(descriptor)


def is_locked(state_dir: Path, *, if_unseen: bool = False) -> bool:
    """Return whether a gateway runs with this folder; `if_unseen` where this user may not see that."""
    try:
        descriptor = os.open(state_dir / FILE, os.O_RDONLY | os.O_CLOEXEC)
    except OSError as error:
        return if_unseen and error.errno in _NOT_PERMITTED
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except OSError as error:
        return isinstance(error, BlockingIOError)
    else:
        return False
    finally:
        os.close(descriptor)


def _open(state_dir: Path) -> int | None:
    path, user = state_dir / FILE, os.getuid()
    try:
        state_dir.mkdir(mode=0o700, parents=True, exist_ok=True)
        return os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
    except OSError as error:
        if error.errno == errno.EROFS and path.exists():  # what can be read can be locked as well
            return os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        if error.errno not in _NOT_PERMITTED:
            _do_without(state_dir, error)
            return None
        if os.access(state_dir, os.W_OK | os.X_OK):
            what = f"{path} is another user's: user {user} may not write it"
            raise StartError(what, f"sudo chown -R {user} {state_dir}") from error
        raise StartError(
            f"state_dir {state_dir}: user {user} may not write there",
            "set state_dir in [gateway] to a folder of this user, or make this one for it: "
            f"sudo install -d -m 700 -o {user} {state_dir}",
        ) from error


def _lock(descriptor: int, state_dir: Path) -> None:
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise StartError(
            f"another gateway ({_holder(descriptor)}) runs with state_dir {state_dir}",
            "stop that one, or give this configuration a name and a state_dir of its own",
        ) from error
    except OSError as error:
        _do_without(state_dir, error)
        return
    with suppress(OSError):  # a full disk: the lock holds all the same
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()} {socket.gethostname()}\n".encode(), 0)


def _holder(descriptor: int) -> str:
    """Return who says in the file that it has the lock."""
    try:
        process, _, host = os.pread(descriptor, _MOST_BYTES, 0).decode("utf-8", "replace").partition(" ")
    except OSError:
        process, host = "", ""
    if not process.isdigit():
        return "process id unknown"
    is_here = host.strip() == socket.gethostname()
    return f"pid {process}" if is_here else f"pid {process} on {host.strip()}"


def _do_without(state_dir: Path, error: OSError) -> None:
    log.warning("state_dir %s: no lock: %s; a second gateway there is not noticed", state_dir, error.strerror)
