"""Metrics of the service for Prometheus, in a registry of its own."""

from __future__ import annotations

from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.platform_collector import PlatformCollector
from prometheus_client.process_collector import ProcessCollector

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30)


class Metrics:
    """Counters, gauges and histograms of the service."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        ProcessCollector(registry=self.registry)
        PlatformCollector(registry=self.registry)
        self.requests = Counter(
            "latentmotion_requests",
            "Requests by route and status; 499 is a client that had gone.",
            ("route", "status"),
            registry=self.registry,
        )
        self.shed = Counter(
            "latentmotion_shed", "Requests refused, by reason.", ("reason",), registry=self.registry
        )
        self.dropped = Counter(
            "latentmotion_dropped", "Requests whose client had gone.", registry=self.registry
        )
        self.request_seconds = self._histogram(
            "latentmotion_request_seconds", "Time of requests.", "route"
        )
        self.seconds = self._histogram("latentmotion_part_seconds", "Time of each part.", "part")
        self.waited = self._histogram("latentmotion_wait_seconds", "Time in the queue.")
        self.late = self._histogram(
            "latentmotion_loop_late_seconds", "How late the event loop was, five times a second."
        )
        self.batch_size = Histogram(
            "latentmotion_batch_size",
            "Motions that were generated together.",
            buckets=(1, 2, 4, 8, 16, 32, 64),
            registry=self.registry,
        )
        self.open = Gauge("latentmotion_open", "Requests under way.", registry=self.registry)
        self.streams = Gauge("latentmotion_streams", "Open streams.", registry=self.registry)
        self.ready = Gauge("latentmotion_ready", "1 if requests are met.", registry=self.registry)

    def watch_queue(self, length: Callable[[], float]) -> None:
        """Exports the length of the queue, read at every scrape."""
        gauge = Gauge("latentmotion_queue", "Motions that wait.", registry=self.registry)
        gauge.set_function(length)

    def text(self) -> bytes:
        """Returns all in Prometheus' format."""
        return generate_latest(self.registry)

    def _histogram(self, name: str, description: str, *labels: str) -> Histogram:
        return Histogram(name, description, labels, buckets=_SECONDS, registry=self.registry)
