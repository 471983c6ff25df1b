# SPDX-License-Identifier: BSD-3-Clause
"""Outputs of real interfaces, shortened, as people published them in reports of bugs and in kernel patches.

Spaces and tabs are as iw has them, where the publication kept them.
"""

DEV_INTEL = """phy#0
\tUnnamed/non-netdev interface
\t\twdev 0x2
\t\taddr 9c:fc:e8:b8:fa:61
\t\ttype P2P-device
\tInterface wlp64s0
\t\tifindex 3
\t\twdev 0x1
\t\taddr 9c:fc:e8:b8:fa:60
\t\tssid whatever
\t\ttype managed
\t\tchannel 100 (5500 MHz), width: 80 MHz, center1: 5530 MHz
\t\ttxpower 22.00 dBm
\t\tmulticast TXQ:
\t\t\tqsz-byt\tqsz-pkt\tflows\tdrops\tmarks\toverlmt\thashcol\ttx-bytes\ttx-packets
\t\t\t0\t0\t0\t0\t0\t0\t0\t0\t\t0
"""

DEV_ATH11K_AP = """phy#0
\tInterface wlp1s0_1
\t\tifindex 6
\t\twdev 0x4
\t\taddr a2:42:d2:1e:89:a3
\t\ttype managed
\t\ttxpower 16.00 dBm
\tInterface wlp1s0_0
\t\tifindex 5
\t\twdev 0x3
\t\taddr 52:e9:be:33:6a:61
\t\tssid test-qe-wpa2-psk
\t\ttype AP
\t\tchannel 13 (2472 MHz), width: 20 MHz, center1: 2472 MHz
\t\ttxpower 14.00 dBm
"""

STATION_INTEL = """Station 04:f0:21:32:3f:d2 (on wlo1)

\tinactive time:\t70 ms
\trx bytes:\t12257886
\trx packets:\t12577
\ttx bytes:\t664158
\ttx packets:\t3441
\ttx retries:\t976
\ttx failed:\t0
\tbeacon loss:\t0
\tbeacon rx:\t2325
\trx drop misc:\t207
\tsignal:  \t-60 [-60, -60] dBm
\tsignal avg:\t-59 dBm
\tbeacon signal avg:\t-58 dBm
\ttx bitrate:\t650.0 MBit/s VHT-MCS 7 80MHz short GI VHT-NSS 2
\ttx duration:\t0 us
\trx bitrate:\t650.0 MBit/s VHT-MCS 7 80MHz short GI VHT-NSS 2
\tauthorized:\tyes
\tpreamble:\tlong
\tMFP:\t\tyes
\tDTIM period:\t2
\tbeacon interval:100
\tshort slot time:yes
\tconnected time:\t233 seconds
\tassociated at [boottime]:\t20613.215s
"""

STATION_ATH12K_EHT = """Station 00:03:7f:12:03:03 (on wlo1)
        inactive time:  48 ms
        rx bytes:       59226
        tx retries:     99
        tx failed:      0
        beacon loss:    0
        signal:         -24 dBm
        beacon signal avg:      -20 dBm
        tx bitrate:     688.2 MBit/s 40MHz EHT-MCS 13 EHT-NSS 2 EHT-GI 0
        rx bitrate:     619.5 MBit/s 40MHz EHT-MCS 8 EHT-NSS 3 EHT-GI 0
"""

STATION_MESH_ATH9K = """Station 00:23:eb:2c:fc:42 (on mesh0)
        inactive time:  56 ms
        rx bytes:       910260
        tx retries:     0
        tx failed:      0
        rx drop misc:   45
        signal:         -56 [-65, -57] dBm
        signal avg:     -57 [-65, -57] dBm
        Toffset:        18446743962739979724 us
        tx bitrate:     78.0 MBit/s MCS 12
        rx bitrate:     18.0 MBit/s
        expected throughput:    43.303Mbps
        mesh llid:      17217
        mesh plink:     ESTAB
        mesh local PS mode:     ACTIVE
        authorized:     yes
"""

STATION_MESH_MT7981_STUCK = """Station e6:26:1f:6c:f3:68 (on phy1-mesh0)
    signal:       -71 [-74, -74] dBm
    signal avg:   -69 [-72, -72] dBm
    tx bitrate:   6.0 MBit/s
    rx bitrate:   576.4 MBit/s 80MHz HE-MCS 5 HE-NSS 2 HE-GI 0 HE-DCM 0
    expected throughput: 5.242Mbps
    tx retries:   47
    tx failed:    47
"""

STATIONS_AP_MT7603 = """Station 70:66:55:ce:21:3d (on phy0-ap0)
        authorized:     yes
        inactive time:  0 ms
        rx bytes:       4917488
        tx bytes:       7797738
        tx retries:     298
        tx failed:      4
        signal:         -29 [-32, -32] dBm
        signal avg:     -29 [-32, -32] dBm
        tx bitrate:     54.0 MBit/s
        rx bitrate:     54.0 MBit/s
        airtime weight: 256
        associated at:  1777673290486 ms

Station ce:3e:3d:40:f3:13 (on phy0-ap0)
        authorized:     yes
        inactive time:  10 ms
        tx retries:     2500
        tx failed:      250
        signal:         -47 [-49, -52] dBm
        tx bitrate:     1.0 MBit/s
        rx bitrate:     6.0 MBit/s
"""

STATION_MWLWIFI_ZEROS = """Station 84:ba:3b:07:53:07 (on wlan1)
        inactive time:  4294825206 ms
        rx bytes:       169993
        tx retries:     0
        tx failed:      0
        signal:         0 dBm
        signal avg:     0 dBm
        tx bitrate:     1.0 MBit/s
        rx bitrate:     1.0 MBit/s
"""

STATION_MT76_OLD = """Station 10:6f:3f:0e:31:8f (on wlan0)
        inactive time:  120 ms
        tx retries:     4589
        tx failed:      0
        signal:         75 [72, 75] dBm
        signal avg:     0 [-3, 0] dBm
        tx bitrate:     54.0 MBit/s
        rx bitrate:     54.0 MBit/s
"""

STATION_MULTI_LINK = """Station 02:00:00:00:01:00 (on wlan0)
\tinactive time:\t328 ms
\ttx retries:\t3
\ttx failed:\t0
\tsignal:\t-33 dBm
\ttx bitrate:\t6.0 MBit/s
\trx bitrate:\t576.4 MBit/s 80MHz EHT-MCS 5 EHT-NSS 2 EHT-GI 0
\tMSDU:
\t\tTID\trx\ttx\ttx retries\ttx failed
\t\t0\t88\t3\t0\t0
\tLink 0:
\t\taddress: 02:00:00:00:01:01
\t\ttx retries:\t1
\t\tsignal:\t-71 dBm
"""

STATION_ATH12K_ZERO = """Station 00:03:7f:04:31:78 (on wlo1)
        tx packets:     342
        tx retries:     64
        tx failed:      0
        beacon loss:    0
        signal:         0 dBm
        beacon signal avg:      -44 dBm
        tx bitrate:     1441.1 MBit/s 80MHz HE-MCS 9 HE-NSS 3 HE-GI 0 HE-DCM 0
        rx bitrate:     1441.1 MBit/s 80MHz HE-MCS 9 HE-NSS 3 HE-GI 0 HE-DCM 0
"""

STATION_MULTI_LINK_ZERO = """Station 02:00:00:00:01:00 (on wlan0)
\ttx retries:\t3
\ttx failed:\t0
\tsignal:\t0 dBm
\tsignal avg:\t0 dBm
\ttx bitrate:\t6.0 MBit/s
\trx bitrate:\t576.4 MBit/s 80MHz EHT-MCS 5 EHT-NSS 2 EHT-GI 0
\tLink 0:
\t\taddress: 02:00:00:00:01:01
\t\ttx retries:\t1
\t\tsignal:\t-71 dBm
\tLink 1:
\t\taddress: 02:00:00:00:01:02
\t\tsignal:\t0 dBm
\t\tsignal avg:\t-52 dBm
\tLink 2:
\t\taddress: 02:00:00:00:01:03
\t\tsignal:\t0 dBm
"""

MESH_DUMP_FAILED = 'failed to parse nested attributes!\n'

LINK_INTEL = """Connected to 98:7e:ca:8a:3e:0e (on wlp0s20f3)
\tSSID: AeP
\tfreq: 5260
\tRX: 2531623 bytes (19490 packets)
\tTX: 27384666 bytes (13466 packets)
\tsignal: -65 dBm
\trx bitrate: 351.0 MBit/s
\ttx bitrate: 260.0 MBit/s

\tbss flags:\tshort-slot-time
\tdtim period:\t2
\tbeacon int:\t100
"""

LINK_BROADCOM_OLD = """Connected to 68:7f:74:3b:b0:01 (on wlan0)
        SSID: tesla-5g-bcm
        freq: 5745
        RX: 30206 bytes (201 packets)
        signal: -31 dBm
        tx bitrate: 300.0 MBit/s MCS 15 40Mhz short GI
"""

LINK_NONE = 'Not connected.\n'

SURVEY_CARL9170 = """Survey data from wlan22
\tfrequency:                      2412 MHz [in use]
\tnoise:                          -86 dBm
\tchannel active time:            3339608 ms
\tchannel busy time:              270982 ms
Survey data from wlan22
\tfrequency:                      2417 MHz
\tnoise:                          -87 dBm
"""

SURVEY_SECOND_IN_USE = """Survey data from wlan0-D-3
\tfrequency:\t\t\t2412 MHz
\tnoise:\t\t\t\t-100 dBm
\tchannel active time:\t\t999 ms
Survey data from wlan0-D-3
\tfrequency:\t\t\t2462 MHz [in use]
\tnoise:\t\t\t\t-90 dBm
\tchannel active time:\t\t76172369 ms
"""

SURVEY_ATH10K_NO_NOISE = """Survey data from wlan0
\tfrequency:                      5180 MHz [in use]
\tchannel active time:            54995 ms
\tchannel busy time:              432 ms
\tchannel receive time:           0 ms
\tchannel transmit time:          59 ms
"""

SURVEY_AX200_RADIO = """Survey data from wlan0
        channel active time:            17205356 ms
        channel receive time:           653 ms
"""

WIRELESS = """Inter-| sta-|   Quality        |   Discarded packets               | Missed | WE
 face | tus | link level noise |  nwid  crypt   frag  retry   misc | beacon | 22
 wlan0: 0000   60.  -50.  -256        0      0      0   1525      0        0
 wlan1: 0000   70.  -39.  -256        0      0      0  12096 191188        208
"""

ROUTES = """Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT
wlan0\t00000000\t0100A8C0\t0003\t0\t0\t600\t00000000\t0\t0\t0
eth0\t00000000\t0101A8C0\t0003\t0\t0\t100\t00000000\t0\t0\t0
wlan0\t0000A8C0\t00000000\t0001\t0\t0\t600\t00FFFFFF\t0\t0\t0
eth0\t0001A8C0\t00000000\t0001\t0\t0\t100\t00FFFFFF\t0\t0\t0
wlan1\t0000000A\t00000000\t0000\t0\t0\t0\t000000FF\t0\t0\t0
"""
"""192.168.0.0/24 by wlan0, 192.168.1.0/24 by eth0, the rest by eth0; a route of wlan1 is down."""

ARP = """IP address       HW type     Flags       HW address            Mask     Device
192.168.0.7      0x1         0x2         CE:3E:3D:40:F3:13     *        phy0-ap0
192.168.0.8      0x1         0x0         00:00:00:00:00:00     *        phy0-ap0
"""
