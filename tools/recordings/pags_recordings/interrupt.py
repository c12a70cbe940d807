# SPDX-License-Identifier: Apache-2.0
"""Signals, as the program pags takes them (cli/common/interrupt.c): what asks a process to end is KeyboardInterrupt, once; a Ctrl-C more than 0.3 s later ends it at once."""

import os
import signal
import sys
import time

ASKING = "SIGINT", "SIGTERM", "SIGHUP", "SIGUSR1", "SIGUSR2", "SIGXCPU"
ONE_PRESS = 0.3  # seconds: a terminal and programs between, such as mpirun, may send several signals for one Ctrl-C
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
    """The process is about to end: nothing is to be stopped any more. Python leaves signals that are ignored so when it ends."""
    for number in (getattr(signal, name) for name in ASKING if hasattr(signal, name)):
        signal.signal(number, signal.SIG_IGN)


def end_with_parent():
    """For preexec_fn: the program that is started ends when this process does, however it does. Linux."""
    import ctypes

    pr_set_pdeathsig = 1
    ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


BEFORE_START = end_with_parent if sys.platform == "linux" else None
