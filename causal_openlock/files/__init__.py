"""Reading and writing files safely, whoever wrote them; what packages register; compiled loops."""
