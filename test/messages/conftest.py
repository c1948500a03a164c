from support.foreign_bags import make

__all__ = ["make"]
