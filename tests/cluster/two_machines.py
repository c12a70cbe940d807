# SPDX-License-Identifier: Apache-2.0
"""Simulates two machines for mpirun by two network namespaces of Linux with a cable between them (requires root)."""

import os
import shutil
import signal
import subprocess


def can_be_made():
    return (
        os.geteuid() == 0
        and shutil.which("ip") is not None
        and subprocess.run(["ip", "netns"], capture_output=True).returncode == 0
    )


class Machines:
    """A command that begins with mpirun() starts rank 0 on the first machine and rank 1 on the second. Only the cable
    connects the machines."""

    def __init__(self, folder):
        mark = f"{os.getpid() % 100000}"
        self.names, self.ends, self.addresses = (
            [f"pags{mark}a", f"pags{mark}b"],
            [f"p{mark}a", f"p{mark}b"],
            ["10.77.0.1", "10.77.0.2"],
        )
        for name in self.names:
            self._ip("netns", "add", name)
        self._ip("link", "add", self.ends[0], "type", "veth", "peer", "name", self.ends[1])
        for name, end, address in zip(self.names, self.ends, self.addresses):
            self._ip("link", "set", end, "netns", name)
            self.ip_of(name, "addr", "add", f"{address}/24", "dev", end)
            self.ip_of(name, "link", "set", "lo", "up")
            self.ip_of(name, "link", "set", end, "up")
        self.hosts, self.agent = os.path.join(folder, "hosts"), os.path.join(folder, "agent.sh")
        with open(self.hosts, "w", encoding="utf-8") as file:
            file.write("".join(f"{address} slots=1\n" for address in self.addresses))
        with open(self.agent, "w", encoding="utf-8") as file:  # replaces ssh: HOST COMMAND...
            file.write(f'#!/bin/sh\nshift\nexec ip netns exec {self.names[1]} sh -c "$*"\n')
        os.chmod(self.agent, 0o755)

    def _ip(self, *words):
        subprocess.run(["ip", *words], check=True, capture_output=True)

    def ip_of(self, name, *words):
        self._ip("netns", "exec", name, "ip", *words)

    def mpirun(self):
        """Returns the begin of an mpirun command, up to the program to start."""
        network = f"{self.addresses[0].rsplit('.', 1)[0]}.0/24"
        settings = {
            "plm_rsh_agent": self.agent,
            "btl": "tcp,self",
            "btl_tcp_if_include": network,
            "oob_tcp_if_include": network,
        }
        options = [word for name, value in settings.items() for word in ("--mca", name, value)]
        return [
            "ip",
            "netns",
            "exec",
            self.names[0],
            "mpirun",
            *options,
            "--hostfile",
            self.hosts,
            "-np",
            "2",
            "--bind-to",
            "none",
        ]

    def cut(self):
        """Disconnects the cable."""
        self.ip_of(self.names[0], "link", "set", self.ends[0], "down")

    def processes(self):
        """Returns {process id: name} of the processes on the two machines."""
        found = {}
        for name in self.names:
            for pid in subprocess.run(["ip", "netns", "pids", name], capture_output=True, text=True).stdout.split():
                try:
                    with open(f"/proc/{pid}/comm", encoding="utf-8") as file:
                        found[int(pid)] = file.read().strip()
                except OSError:
                    pass
        return found

    def remove(self):
        for pid in self.processes():
            os.kill(pid, signal.SIGKILL)
        for name in self.names:
            subprocess.run(["ip", "netns", "del", name], check=False, capture_output=True)
