"""What several tests share: records made up by hand, independent implementations, clients."""
