"""Recorded motions of an arm: tables of joints and poses from files."""
