"""A pytest plugin: ``pytest --tuff`` runs a suite's Vulkan programs on Tuff.

The driver is activated before any ``conftest.py`` or test is imported, and child processes inherit it.
"""

import pytest

import tuff


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.getgroup("tuff").addoption(
        "--tuff", action="store_true", help="run Vulkan programs on Tuff, a driver that traces rays on the CPU"
    )


@pytest.hookimpl(tryfirst=True)
def pytest_load_initial_conftests(early_config: pytest.Config) -> None:
    if early_config.known_args_namespace.tuff:
        try:
            tuff.activate()
        except RuntimeError as error:
            raise pytest.UsageError(str(error)) from error


def pytest_report_header(config: pytest.Config) -> "str | None":
    return f"tuff: {tuff.manifest()}" if config.getoption("--tuff") else None
