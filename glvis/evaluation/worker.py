"""A worker process that makes maps for another: sent a scene once, then jobs, until that is gone.

Started by ``workers`` as ``python -m glvis.evaluation.worker FD``, never forked: a forked child of
a process with an OpenGL context hangs. It imports what draws, and nothing that reads studies.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
from contextlib import suppress
from multiprocessing.connection import Connection

from glvis.visibility.maps import LocalMaps, MapScene


def serve(connection: Connection) -> None:
    """Answer until the other end is gone.

    Receives the pickled MapScene, then pairs of a tag and a MapJob; sends "here" at once,
    then ("ready", GlInfo), then pairs of the tag and the maps. An error is sent as ("raised",
    error) and ends the process.
    """
    connection.send(("here", None))
    scene: MapScene = pickle.loads(connection.recv_bytes())
    try:
        maps = LocalMaps(scene)
        connection.send(("ready", maps.gl))
        while True:
            tag, job = connection.recv()
            connection.send((tag, next(maps.make([job]))))
    except (EOFError, OSError):
        raise  # of the connection
    except Exception as error:
        connection.send(("raised", error))


def main() -> None:
    """Serve on the file descriptor that the command line names."""
    for name in ("SIGINT", "SIGHUP"):  # Ctrl-C, a closed terminal: the other process's to decide
        if hasattr(signal, name):  # Windows has no SIGHUP
            signal.signal(getattr(signal, name), signal.SIG_IGN)
    with suppress(EOFError, BrokenPipeError, ConnectionResetError):  # the other one has ended
        serve(Connection(int(sys.argv[1])))
    os._exit(0)  # drivers take their time, and at times crash, when they are taken down


if __name__ == "__main__":
    main()
