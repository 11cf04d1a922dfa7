"""A Dask cluster of processes on this machine, for tests and benchmarks."""

import json
import os
import subprocess
import sys
from pathlib import Path

from helpers.processes import wait_for


class Cluster:
    """A Dask cluster of processes on this machine, its workers of one thread each."""

    def __init__(self, folder, *, options=(), environment=None):
        self._file, self._options = folder / "scheduler.json", options
        self._settings = {
            "stdout": subprocess.DEVNULL,
            "stderr": subprocess.DEVNULL,
            "cwd": folder,
            # One thread each in BLAS as well, as a nanny would see to.
            "env": {
                **(environment or os.environ),
                "PYTHONPATH": str(Path(__file__).parents[1]),
                "OPENBLAS_NUM_THREADS": "1",
                # Nobody looks at where the workers' time went, which is asked a hundred times a second.
                "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False",
            },
        }
        self._scheduler = self._started("dask_scheduler", "--port", "0")
        self.workers = []
        wait_for(self._told)
        self.address = self._told()["address"]

    def _told(self):
        """What the scheduler says of itself, when its file is whole: it is there before it is written."""
        try:
            return json.loads(self._file.read_text())
        except (FileNotFoundError, ValueError):
            return None

    def _started(self, name, *arguments):
        command = [sys.executable, "-m", f"distributed.cli.{name}", "--scheduler-file", self._file, "--no-dashboard"]
        return subprocess.Popen([*command, *self._options, *arguments], **self._settings)

    def start_worker(self):
        self.workers.append(self._started("dask_worker", "--nthreads", "1", "--no-nanny"))

    def of(self, workers):
        """The address of the cluster, which has so many workers now."""
        from distributed import Client

        while len(self.workers) < workers:
            self.start_worker()
        # By one client: to connect takes the scheduler and us longer than a worker takes to say that it is there.
        with Client(self.address, set_as_default=False) as client:
            client.wait_for_workers(workers, timeout=60)
            wait_for(lambda: len(client.nthreads()) == workers)  # without those that were lost
        return self.address

    def processor_seconds(self):
        """That all workers took of the processor so far."""
        import psutil

        times = [psutil.Process(worker.pid).cpu_times() for worker in self.workers]
        return sum(time.user + time.system for time in times)

    def kill_one(self):
        worker = self.workers.pop()
        worker.kill()
        worker.wait()

    def end(self):
        for process in (*self.workers, self._scheduler):
            process.kill()
            process.wait()
