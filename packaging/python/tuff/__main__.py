"""The command ``tuff``: becomes the program that came along."""

import os
import sys

from . import program


def main() -> None:
    path = program()
    try:
        os.execv(path, ["tuff", *sys.argv[1:]])
    except OSError as error:
        sys.exit(f"tuff: {path} cannot be started: {error.strerror}: install tuff-vulkan again")


if __name__ == "__main__":
    main()
