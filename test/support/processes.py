"""Ends of processes that tests start, and what these print."""

import codecs
import contextlib
import os
import signal
import subprocess
import threading

PATIENCE_S = 60.0


def end(process):
    """Interrupt a process as Ctrl-C does; kill it only if it does not end."""
    if process.poll() is None:
        process.send_signal(signal.SIGINT)
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(PATIENCE_S)
    if process.poll() is None:
        process.kill()
        process.wait()


class Output:
    """What a process prints, read while it runs."""

    def __init__(self, stream):
        self.text = ""
        self._thread = threading.Thread(target=self._read, args=(stream,), daemon=True)
        self._thread.start()

    def _read(self, stream):
        decoder = codecs.getincrementaldecoder("utf-8")()  # a character may come in two pieces
        with contextlib.suppress(OSError):  # reading a closed terminal raises an error
            while data := os.read(stream, 65536):
                self.text += decoder.decode(data)

    def finish(self):
        """The whole, after the process has ended."""
        self._thread.join(PATIENCE_S)
        return self.text
