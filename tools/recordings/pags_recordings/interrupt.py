# SPDX-License-Identifier: Apache-2.0
"""Signal handling as in the program pags (cli/common/interrupt.c): a request to end raises KeyboardInterrupt once; a Ctrl-C more than 0.3 s later ends the process
immediately."""

import os
import signal
import sys
import time

ASKING = "SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU"
ONE_PRESS = 0.3  # seconds: a terminal and programs such as mpirun may send several signals for one Ctrl-C
BY_CTRL_C = 130
since = None


def install():
    global since
    since = None
    for number in (getattr(signal, name) for name in ASKING if hasattr(signal, name)):
        if number == signal.SIGINT or signal.getsignal(number) != signal.SIG_IGN:  # under nohup SIGHUP is ignored
            signal.signal(number, on_signal)


def on_signal(number, _):
    global since
    if since is None:
        since = time.monotonic()
        raise KeyboardInterrupt
    if number == signal.SIGINT and time.monotonic() - since >= ONE_PRESS:
        os._exit(BY_CTRL_C)


def ignore():
    """Called when the process is about to end: ignores further signals. Python restores no handlers for ignored signals at exit."""
    for number in (getattr(signal, name) for name in ASKING if hasattr(signal, name)):
        signal.signal(number, signal.SIG_IGN)


def end_with_parent():
    """For preexec_fn: the child process ends when this one does, for any reason. Linux."""
    import ctypes

    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


BEFORE_START = end_with_parent if sys.platform == "linux" else None
