# SPDX-License-Identifier: Apache-2.0
"""Starts programs by mpirun. Allows root as the user and more ranks than processors."""

import os
import subprocess


def environment(**more):
    """Returns the environment with Open MPI's settings for tests and the variables `more`."""
    settings = {
        "OMPI_ALLOW_RUN_AS_ROOT": "1",
        "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
        "OMPI_MCA_rmaps_base_oversubscribe": "1",
        "OMPI_MCA_hwloc_base_binding_policy": "none",
    }
    return {**os.environ, **settings, **more}


def start(ranks, command, **more):
    return subprocess.Popen(
        ["mpirun", "-np", str(ranks), *command],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment(**more),
    )


def run(ranks, command, timeout=120, **more):
    """Runs a command on `ranks` ranks to its end. `more` are variables of its environment. Raises an error after
    `timeout` seconds."""
    process = start(ranks, command, **more)
    try:
        out, err = process.communicate(timeout=timeout)
    except subprocess.TimeoutExpired:
        process.kill()
        raise
    return subprocess.CompletedProcess(process.args, process.returncode, out, err)
