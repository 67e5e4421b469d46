"""Multi-resolution MAP tomosynthesis, measured: chapter 2 of Chen's dissertation (Delaware, 2006) and beyond."""
