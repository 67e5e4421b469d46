"""Cuts a tetrahedral mesh along a blade's surface, by virtual nodes."""
