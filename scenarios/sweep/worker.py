"""python -m scenarios.sweep.worker ADDRESS: one worker with one thread, which ends when its stdin does.

Dask's nannies lose a worker that dies in the moment it starts; these are restarted by `processes.Processes`.
"""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
import threading


async def work(address: str) -> None:
    """Serve a scheduler until it is gone."""
    from distributed import Worker

    quiet = logging.CRITICAL
    async with Worker(
        address, nthreads=1, memory_limit=0, dashboard=False, host="127.0.0.1", silence_logs=quiet
    ) as worker:
        await worker.finished()


def end_with_parent() -> None:
    """Leave at once, whatever is being computed, when whoever started this process is gone."""
    sys.stdin.buffer.read()
    os._exit(0)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the sweep, which ends its workers
    threading.Thread(target=end_with_parent, daemon=True).start()
    asyncio.run(work(sys.argv[1]))
