"""Rooms: several people at several sites touch one organ, each with a role that an invitation gives."""
