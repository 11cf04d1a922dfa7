"""A profile of a TI radar, short chirps, as its demo's command line takes it."""

PROFILE = """\
% 128 samples of a chirp, one transmitter, a frame every 5 ms
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 1 0
adcCfg 2 1
adcbufCfg -1 0 0 1 1
profileCfg 0 77 7 6 63 0 0 58.6116 1 128 10000 0 0 30
chirpCfg 0 0 0 0 0 0 0 1
frameCfg 0 0 1 100 5 1 0
lvdsStreamCfg -1 0 1 0
sensorStart
"""
