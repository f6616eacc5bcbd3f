"""Worker processes of this machine, restarted when they die."""

from __future__ import annotations

import os
import subprocess
import sys

from slam.cli import InputError

SINGLE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
HOPELESS = 20
"""Deaths in a row, without a job that ended, after which no worker is started any more."""


class Processes:
    """So many workers of the scheduler at ``address``; a context that ends them."""

    def __init__(self, address: str, number: int) -> None:
        self.address = address
        self.running = [self._start() for _ in range(number)]
        self.deaths = 0

    def __enter__(self) -> Processes:
        return self

    def __exit__(self, *unused: object) -> None:
        for process in self.running:
            process.kill()
        for process in self.running:
            process.communicate()

    def tend(self, useful: bool) -> None:
        """Replace the dead; ``useful``: a job ended since the last call. Raises `InputError` in the end."""
        self.deaths = 0 if useful else self.deaths
        for k, process in enumerate(self.running):
            if process.poll() is None:
                continue
            process.communicate()
            self.deaths += 1
            if self.deaths > HOPELESS:
                raise InputError(f"workers die as they start, the last with exit code {process.returncode}")
            self.running[k] = self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        """A process that finds the modules which this one finds, its libraries on one thread."""
        paths = os.pathsep.join(path or os.getcwd() for path in sys.path)
        environment = os.environ | dict.fromkeys(SINGLE, "1") | {"PYTHONPATH": paths}
        command = [sys.executable, "-m", "scenarios.sweep.worker", self.address]
        return subprocess.Popen(command, stdin=subprocess.PIPE, env=environment)
