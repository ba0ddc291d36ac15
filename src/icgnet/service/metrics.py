"""Counts and times for Prometheus."""

from collections.abc import Callable

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

SECONDS = (0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6)
MEDIA = "text/plain; version=0.0.4; charset=utf-8"


class Metrics:
    """The metrics of one service.

    Args:
        taken: how many places are taken at the moment.
    """

    def __init__(self, taken: Callable[[], float]) -> None:
        self._registry = CollectorRegistry()
        self.requests = Counter(
            "icgnet_requests", "Requests by route and status.", ("route", "status"), registry=self._registry
        )
        self.waiting = Histogram(
            "icgnet_waiting_seconds",
            "From a request's first byte to the start of its prediction.",
            buckets=SECONDS,
            registry=self._registry,
        )
        self.predicting = Histogram(
            "icgnet_prediction_seconds", "Time of a prediction.", buckets=SECONDS, registry=self._registry
        )
        self.planning = Histogram(
            "icgnet_planning_seconds", "Time of planning a pick.", buckets=SECONDS, registry=self._registry
        )
        self.plans = Counter("icgnet_plans", "Picks that can be carried out.", registry=self._registry)
        self.objects = Counter("icgnet_objects", "Objects that were found.", registry=self._registry)
        self.grasps = Counter("icgnet_grasps", "Grasps that were found.", registry=self._registry)
        in_house = Gauge("icgnet_requests_in_house", "Requests that run or wait.", registry=self._registry)
        in_house.set_function(taken)

    def page(self) -> bytes:
        """All metrics as text."""
        return generate_latest(self._registry)
