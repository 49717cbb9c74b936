"""The command ``tuff``: becomes the program that came along; on Windows, where that is not possible, ends with it."""

import os
import signal
import subprocess
import sys

from . import program


def main() -> None:
    path = program()
    try:
        if sys.platform == "win32":
            # The console tells the program of Ctrl-C, too: it decides.
            signal.signal(signal.SIGINT, signal.SIG_IGN)
            code = subprocess.call([str(path), *sys.argv[1:]])
            # Codes of Windows are unsigned, those of Python signed.
            sys.exit(code - (1 << 32) if code >= 1 << 31 else code)
        os.execv(path, ["tuff", *sys.argv[1:]])
    except OSError as error:
        sys.exit(f"tuff: {path} cannot be started: {error.strerror}: install tuff-vulkan again")


if __name__ == "__main__":
    main()
