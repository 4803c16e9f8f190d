"""One run trained by several processes that torchrun starts (docs/distributed.md)."""
