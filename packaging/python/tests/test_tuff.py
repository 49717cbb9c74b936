"""What the wheel promises, on the wheel that is installed: `pytest --tuff packaging/python/tests`."""

import ctypes
import os
import subprocess
import sys

import tuff

IS_WINDOWS = sys.platform == "win32"


def devices():
    """Names of the devices that this process finds, by the Vulkan loader alone."""
    vulkan = ctypes.CDLL("vulkan-1.dll" if IS_WINDOWS else "libvulkan.so.1")

    class InstanceCreateInfo(ctypes.Structure):
        _fields_ = [
            ("type", ctypes.c_int),
            ("next", ctypes.c_void_p),
            ("flags", ctypes.c_uint32),
            ("application", ctypes.c_void_p),
            ("layer_count", ctypes.c_uint32),
            ("layers", ctypes.c_void_p),
            ("extension_count", ctypes.c_uint32),
            ("extensions", ctypes.c_void_p),
        ]

    info = InstanceCreateInfo(type=1)
    instance = ctypes.c_void_p()
    assert vulkan.vkCreateInstance(ctypes.byref(info), None, ctypes.byref(instance)) == 0
    count = ctypes.c_uint32()
    assert vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), None) == 0
    handles = (ctypes.c_void_p * count.value)()
    assert vulkan.vkEnumeratePhysicalDevices(instance, ctypes.byref(count), handles) == 0
    names = []
    for handle in handles:
        # VkPhysicalDeviceProperties: five words, then the name; 824 bytes in all.
        properties = ctypes.create_string_buffer(1024)
        vulkan.vkGetPhysicalDeviceProperties(ctypes.c_void_p(handle), properties)
        names.append(properties.raw[20:276].split(b"\0")[0].decode())
    vulkan.vkDestroyInstance(instance, None)
    return names


def test_this_process_finds_tuff_alone(request):
    assert request.config.getoption("--tuff"), "run with --tuff"
    (name,) = devices()
    assert name.startswith("Tuff (")


def test_children_find_tuff(request):
    code = "import sys; sys.path.insert(0, sys.argv[1]); import test_tuff; print(*test_tuff.devices())"
    here = os.path.dirname(__file__)
    child = subprocess.run([sys.executable, "-c", code, here], capture_output=True, text=True, check=True)
    assert child.stdout.startswith("Tuff (")


def test_activating_twice_changes_nothing():
    before = dict(os.environ)
    tuff.activate()
    assert dict(os.environ) == before


def test_files_are_there():
    assert tuff.manifest().is_file()
    assert os.access(tuff.program(), os.X_OK)


def test_module_and_command_are_the_same():
    by_module = subprocess.run([sys.executable, "-m", "tuff", "--version"], capture_output=True, text=True, check=True)
    by_name = subprocess.run([str(tuff.program()), "--version"], capture_output=True, text=True, check=True)
    assert by_module.stdout == by_name.stdout
    assert by_name.stdout.startswith("tuff ")


def test_info_has_no_problem():
    info = subprocess.run([str(tuff.program()), "info"], capture_output=True, text=True, check=False)
    assert info.returncode == 0, info.stdout + info.stderr
    assert "problem:" not in info.stdout
    assert "Tuff (" in info.stdout


def test_programs_exit_codes_pass_through():
    shell = ["cmd", "/c"] if IS_WINDOWS else ["sh", "-c"]
    run = subprocess.run([str(tuff.program()), "run", "--", *shell, "exit 7"], check=False)
    assert run.returncode == 7
    missing = subprocess.run([str(tuff.program()), "run", "no-such-program"], capture_output=True, text=True, check=False)
    assert missing.returncode == 127
    assert "no-such-program: no such program" in missing.stderr
