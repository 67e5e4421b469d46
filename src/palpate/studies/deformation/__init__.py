"""Springs against finite elements, measured: chapter 3 of Chen's dissertation (Delaware, 2006) and beyond."""
