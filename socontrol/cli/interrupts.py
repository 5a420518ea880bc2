"""Ctrl-C that is not forgotten: compiled code swallows some KeyboardInterrupts, so each one is noted as well."""

import signal
import threading


class Interrupts:
    """While it is entered, Ctrl-C raises KeyboardInterrupt as ever and sets `seen`."""

    def __init__(self):
        self.seen, self._before = False, None

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(self, *error):
        if self._before is not None:
            signal.signal(signal.SIGINT, self._before)

    def _note(self, number, frame):
        self.seen = True
        raise KeyboardInterrupt

    def check(self):
        """Raise the KeyboardInterrupt that was swallowed."""
        if self.seen:
            raise KeyboardInterrupt
