"""Measurements that explain the numbers of the benchmark, and are made once in a while."""
