"""Chapter 3's real-time tables of Chen's dissertation (Delaware, 2006), measured on this machine."""
