"""Mistry 2008's experiments in MuJoCo: CBi balances, draws and switches contacts."""
