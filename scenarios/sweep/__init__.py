"""Many trials that survive: on a cluster, each kept the moment it is done, and never done twice.

A sweep takes trials (scenario, seed, method, configuration) and a function that runs one of them. Answers
go into an SQLite file, one transaction each; killed and started again, the sweep goes on where it was.
"""

from scenarios.sweep.run import SweepResult, check, finish, sweep, write_results
from scenarios.sweep.trial import Answer, Failure, Trial

__all__ = ["Answer", "Failure", "SweepResult", "Trial", "check", "finish", "sweep", "write_results"]
