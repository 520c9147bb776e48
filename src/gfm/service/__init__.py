"""What every service process shares: settings, signals, the loop, and its status."""

from gfm.service.command import (
    exit_status,
    make_parser,
    open_transport,
    parse_config,
    serve,
    service_main,
)
from gfm.service.config import ServiceConfig, read_config
from gfm.service.logs import start_logging
from gfm.service.loop import run_service
from gfm.service.service import RunningService, Service, make_status
from gfm.service.signals import StopSignal

__all__ = [
    "RunningService",
    "Service",
    "ServiceConfig",
    "StopSignal",
    "exit_status",
    "make_parser",
    "make_status",
    "open_transport",
    "parse_config",
    "read_config",
    "run_service",
    "serve",
    "service_main",
    "start_logging",
]
