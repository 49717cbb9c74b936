"""Tuff: a Vulkan driver that traces rays on the CPU.

``tuff.activate()`` makes Vulkan programs of this process use Tuff; call it before the first of them is imported::

    import tuff
    tuff.activate()
    import slangpy

The command ``tuff run -- PROGRAM`` (or ``python -m tuff run -- PROGRAM``) does the same for any program, and ``tuff info``
tells what Vulkan programs find, and how to fix problems.
"""

import ctypes
import os
import sys
from pathlib import Path
from typing import Dict, Optional

__all__ = ["activate", "environment", "loader", "manifest", "program"]

#: The folders bin, lib and share of the installation.
_PREFIX = Path(__file__).resolve().parent / "prefix"

_IS_WINDOWS = sys.platform == "win32"

#: The name with which programs open the Vulkan loader.
_LOADER = "vulkan-1.dll" if _IS_WINDOWS else "libvulkan.so.1"

#: The variable with the folders of libraries.
_LIBRARY_FOLDERS = "PATH" if _IS_WINDOWS else "LD_LIBRARY_PATH"

#: The command that installs a loader on this system.
_INSTALL_LOADER = (
    "`winget install KhronosGroup.VulkanRT`"
    if _IS_WINDOWS
    else "`apt-get install libvulkan1`, or as your distribution names it"
)

#: The loader that was opened, which stays open.
_opened: Optional[ctypes.CDLL] = None


def manifest() -> Path:
    """The driver's manifest, which the variable ``VK_DRIVER_FILES`` can name."""
    return _PREFIX / "share" / "vulkan" / "icd.d" / "tuff_icd.json"


def program() -> Path:
    """The program ``tuff``."""
    return _PREFIX / "bin" / ("tuff.exe" if _IS_WINDOWS else "tuff")


def loader() -> Optional[Path]:
    """The package's Vulkan loader, for systems without one; ``None`` if the package has none."""
    path = _PREFIX / "lib" / "tuff" / "loader" / _LOADER
    return path if path.exists() else None


def _system_has_loader() -> bool:
    try:
        # On Windows as programs look for it: in the folders of PATH, too.
        ctypes.CDLL(_LOADER, **({"winmode": 0} if _IS_WINDOWS else {}))
    except OSError:
        return False
    return True


def environment() -> Dict[str, str]:
    """Variables with which a child process sees Tuff and no other driver.

    ``LD_LIBRARY_PATH`` (on Windows ``PATH``) is among them where the system has no Vulkan loader. Merge them with ``os.environ``.
    """
    variables = {
        "VK_DRIVER_FILES": str(manifest()),
        # The name that loaders before 1.3.207 read.
        "VK_ICD_FILENAMES": str(manifest()),
    }
    own = loader()
    # What activate() opened is not the system's.
    if own is not None and (_opened is not None or not _system_has_loader()):
        folders = [folder for folder in os.environ.get(_LIBRARY_FOLDERS, "").split(os.pathsep) if folder]
        if str(own.parent) not in folders:
            folders.append(str(own.parent))
        variables[_LIBRARY_FOLDERS] = os.pathsep.join(folders)
    return variables


def activate() -> None:
    """Makes Vulkan programs of this process, and of its children, use Tuff.

    Call it before anything creates a Vulkan instance: the loader reads its variables then. A system's loader wins; where there is
    none, the one that came along is opened, so that whoever asks for ``libvulkan.so.1`` (on Windows ``vulkan-1.dll``) later gets it.

    Raises ``RuntimeError`` where there is no loader that can be loaded, or where the process has more rights than its user: the loader would
    ignore the variables. On Windows that is a process that runs as administrator; it finds a driver that ``tuff install`` registered
    for all users, and nothing is raised then.
    """
    global _opened
    if _IS_WINDOWS and _runs_as_administrator() and not _is_registered_for_all_users():
        raise RuntimeError(
            "tuff: this process runs as administrator, and the Vulkan loader then ignores VK_DRIVER_FILES: say `tuff install`, "
            "which registers the driver for all users"
        )
    if not _IS_WINDOWS and _runs_with_more_rights():
        raise RuntimeError(
            "tuff: this process has more rights than its user, and the Vulkan loader then ignores VK_DRIVER_FILES: "
            "install the driver for the whole system (the package tuff-vulkan)"
        )
    if _opened is None and not _system_has_loader():
        own = loader()
        if own is None:
            raise RuntimeError(f"tuff: there is no Vulkan loader ({_LOADER}): install it with {_INSTALL_LOADER}")
        try:
            _opened = ctypes.CDLL(str(own), mode=ctypes.RTLD_GLOBAL)
        except OSError as error:
            # It is a distribution's, and may need a newer C library than this system has.
            raise RuntimeError(
                f"tuff: there is no Vulkan loader ({_LOADER}; the one that came along does not load: {error}): install it with "
                f"{_INSTALL_LOADER}"
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


def _runs_as_administrator() -> bool:
    """Whether this process has Windows' integrity level high, as the loader asks, too."""
    token_query, token_integrity_level, high = 0x8, 25, 0x3000
    pointer = ctypes.c_void_p
    system, rights = ctypes.WinDLL("kernel32"), ctypes.WinDLL("advapi32")
    system.GetCurrentProcess.restype = pointer
    system.CloseHandle.argtypes = [pointer]
    rights.OpenProcessToken.argtypes = [pointer, ctypes.c_uint32, ctypes.POINTER(pointer)]
    rights.GetTokenInformation.argtypes = [pointer, ctypes.c_int, pointer, ctypes.c_uint32, ctypes.POINTER(ctypes.c_uint32)]
    rights.GetSidSubAuthorityCount.argtypes = [pointer]
    rights.GetSidSubAuthorityCount.restype = ctypes.POINTER(ctypes.c_uint8)
    rights.GetSidSubAuthority.argtypes = [pointer, ctypes.c_uint32]
    rights.GetSidSubAuthority.restype = ctypes.POINTER(ctypes.c_uint32)
    token = pointer()
    if not rights.OpenProcessToken(system.GetCurrentProcess(), token_query, ctypes.byref(token)):
        return False
    try:
        # TOKEN_MANDATORY_LABEL: a pointer to the SID, which lies behind it, and attributes.
        label, length = (pointer * 16)(), ctypes.c_uint32()
        if not rights.GetTokenInformation(token, token_integrity_level, label, ctypes.sizeof(label), ctypes.byref(length)):
            return False
        count = rights.GetSidSubAuthorityCount(label[0])[0]
        return count > 0 and rights.GetSidSubAuthority(label[0], count - 1)[0] >= high
    finally:
        system.CloseHandle(token)


def _is_registered_for_all_users() -> bool:
    """Whether ``tuff install`` wrote this manifest for all users of Windows."""
    import winreg

    def is_this(path: str) -> bool:
        try:
            # It may be registered by its folder's short name.
            return os.path.samefile(path, manifest())
        except OSError:
            return False

    try:
        with winreg.OpenKey(winreg.HKEY_LOCAL_MACHINE, r"SOFTWARE\Khronos\Vulkan\Drivers") as key:
            count = winreg.QueryInfoKey(key)[1]
            values = [winreg.EnumValue(key, index) for index in range(count)]
    except OSError:
        return False
    return any(value == 0 and is_this(name) for name, value, _ in values)
