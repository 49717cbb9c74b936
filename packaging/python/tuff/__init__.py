"""Tuff: a Vulkan driver that traces rays on the CPU.

``tuff.activate()`` makes Vulkan programs of this process use Tuff; call it before the first of them is imported::

    import tuff
    tuff.activate()
    import slangpy

The command ``tuff run -- PROGRAM`` (or ``python -m tuff run -- PROGRAM``) does the same for any program, and ``tuff info``
tells what programs find, and what mends what is wrong.
"""

import ctypes
import os
from pathlib import Path
from typing import Dict, Optional

__all__ = ["activate", "environment", "loader", "manifest", "program"]

#: The folders bin, lib and share of the installation.
_PREFIX = Path(__file__).resolve().parent / "prefix"

#: The name by which programs open the Vulkan loader.
_LOADER = "libvulkan.so.1"

#: What was opened stays open.
_opened: Optional[ctypes.CDLL] = None


def manifest() -> Path:
    """The driver's manifest, which the variable ``VK_DRIVER_FILES`` can name."""
    return _PREFIX / "share" / "vulkan" / "icd.d" / "tuff_icd.json"


def program() -> Path:
    """The program ``tuff``."""
    return _PREFIX / "bin" / "tuff"


def loader() -> Optional[Path]:
    """The Vulkan loader that came along, for systems that have none; ``None`` where none came."""
    path = _PREFIX / "lib" / "tuff" / "loader" / _LOADER
    return path if path.exists() else None


def _system_has_loader() -> bool:
    try:
        ctypes.CDLL(_LOADER)
    except OSError:
        return False
    return True


def environment() -> Dict[str, str]:
    """Variables with which a child process sees Tuff and no other driver.

    ``LD_LIBRARY_PATH`` is among them where the system has no Vulkan loader. Merge them with ``os.environ``.
    """
    variables = {
        "VK_DRIVER_FILES": str(manifest()),
        # The name that loaders before 1.3.207 read.
        "VK_ICD_FILENAMES": str(manifest()),
    }
    own = loader()
    # What activate() opened is not the system's.
    if own is not None and (_opened is not None or not _system_has_loader()):
        folders = [folder for folder in os.environ.get("LD_LIBRARY_PATH", "").split(":") if folder]
        if str(own.parent) not in folders:
            folders.append(str(own.parent))
        variables["LD_LIBRARY_PATH"] = ":".join(folders)
    return variables


def activate() -> None:
    """Makes Vulkan programs of this process, and of its children, use Tuff.

    Call it before anything creates a Vulkan instance: the loader reads its variables then. A system's loader wins; where there is
    none, the one that came along is opened, so that whoever asks for ``libvulkan.so.1`` later gets it.

    Raises ``RuntimeError`` where there is no loader that can be loaded, or where the process has more rights than its user: the loader would
    ignore the variables.
    """
    global _opened
    if _runs_with_more_rights():
        raise RuntimeError(
            "tuff: this process has more rights than its user, and the Vulkan loader then ignores VK_DRIVER_FILES: "
            "install the driver for the whole system (the package tuff-vulkan)"
        )
    if _opened is None and not _system_has_loader():
        own = loader()
        if own is None:
            raise RuntimeError(
                "tuff: there is no Vulkan loader (libvulkan.so.1): install it with `apt-get install libvulkan1`, or as your "
                "distribution names it"
            )
        try:
            _opened = ctypes.CDLL(str(own), mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            # It is a distribution's, and may need a newer C library than this system has.
            raise RuntimeError(
                f"tuff: there is no Vulkan loader (libvulkan.so.1; the one that came along does not load: {error}): install it "
                "with `apt-get install libvulkan1`, or as your distribution names it"
            ) from error
    os.environ.update(environment())
    os.environ.pop("VK_ADD_DRIVER_FILES", None)


def _runs_with_more_rights() -> bool:
    """Whether the kernel started this process in secure mode (``AT_SECURE`` of getauxval(3)), as the loader asks, too."""
    at_secure = 23
    getauxval = ctypes.CDLL(None).getauxval
    getauxval.restype = ctypes.c_ulong
    getauxval.argtypes = [ctypes.c_ulong]
    return getauxval(at_secure) != 0
