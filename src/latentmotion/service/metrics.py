"""Metrics of the service for Prometheus, in a registry of its own."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest
from prometheus_client.platform_collector import PlatformCollector
from prometheus_client.process_collector import ProcessCollector

MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"

_SECONDS = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1, 2.5, 5, 10, 30)


class Metrics:
    """Counters, gauges and histograms of the service."""

    def __init__(self) -> None:
        registry = self.registry = CollectorRegistry()
        ProcessCollector(registry=registry)
        PlatformCollector(registry=registry)
        counter, gauge = partial(Counter, registry=registry), partial(Gauge, registry=registry)
        histogram = partial(Histogram, buckets=_SECONDS, registry=registry)
        about = "Requests by route and status; 499 is a client that had gone."
        self.requests = counter("latentmotion_requests", about, ("route", "status"))
        self.shed = counter("latentmotion_shed", "Requests refused, by reason.", ("reason",))
        self.dropped = counter("latentmotion_dropped", "Requests whose client had gone.")
        took = "Time of requests."
        self.request_seconds = histogram("latentmotion_request_seconds", took, ("route",))
        self.seconds = histogram("latentmotion_part_seconds", "Time of each part.", ("part",))
        self.waited = histogram("latentmotion_wait_seconds", "Time in the queue.")
        late = "How late the event loop was, five times a second."
        self.late = histogram("latentmotion_loop_late_seconds", late)
        together = "Motions that were generated together."
        sizes = (1, 2, 4, 8, 16, 32, 64)
        self.batch_size = histogram("latentmotion_batch_size", together, buckets=sizes)
        self.open = gauge("latentmotion_open", "Requests under way.")
        self.streams = gauge("latentmotion_streams", "Open streams.")
        self.ready = gauge("latentmotion_ready", "1 if requests are met.")

    def watch_queue(self, length: Callable[[], float]) -> None:
        """Exports the length of the queue, read at every scrape."""
        gauge = Gauge("latentmotion_queue", "Motions that wait.", registry=self.registry)
        gauge.set_function(length)

    def text(self) -> bytes:
        """Returns all in Prometheus' format."""
        return generate_latest(self.registry)
