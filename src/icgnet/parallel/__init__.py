"""Many workers on one job, on one machine or a cluster: pools that survive dead workers, and the lock of a folder."""
