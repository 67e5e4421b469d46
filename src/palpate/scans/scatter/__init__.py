"""Scattered X-rays: cross sections, Monte Carlo, kernels, and the estimate of a scan's scatter."""
