"""Fast DDS' profile of a participant that meets one peer host, and no other program."""

from __future__ import annotations

from haptic_accel.links.addresses import Route

PROFILE = """<?xml version="1.0" encoding="UTF-8" ?>
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <transport_descriptors>
    <transport_descriptor>
      <transport_id>link</transport_id>
      <type>UDPv4</type>
      <interfaceWhiteList>
        <address>{own}</address>
      </interfaceWhiteList>
      <receiveBufferSize>4194304</receiveBufferSize>
      <maxMessageSize>1300</maxMessageSize>
      <non_blocking_send>true</non_blocking_send>
    </transport_descriptor>
  </transport_descriptors>
  <participant profile_name="link" is_default_profile="true">
    <rtps>
      <userTransports>
        <transport_id>link</transport_id>
      </userTransports>
      <useBuiltinTransports>false</useBuiltinTransports>
      <defaultUnicastLocatorList>
        {own_locator}
      </defaultUnicastLocatorList>
      <builtin>
        <discovery_config>
          <leaseDuration>
            <sec>3</sec>
          </leaseDuration>
          <leaseAnnouncement>
            <sec>0</sec>
            <nanosec>200000000</nanosec>
          </leaseAnnouncement>
        </discovery_config>
        <metatrafficUnicastLocatorList>
          {own_locator}
        </metatrafficUnicastLocatorList>
        <initialPeersList>
          {peer_locator}
        </initialPeersList>
      </builtin>
    </rtps>
  </participant>
</profiles>
"""
"""Discovery and data share one port, for one rule of a firewall. The locators keep the middleware
from multicast. Announcements five times a second let a peer that is started again be met in time;
the lease forgets one that was killed after fifteen of them. What discovery tells goes in messages
that cross the network whole: with 5 % loss, one of 12 kB in nine pieces was not there for seconds.
They are as large as to take the longest datagram with its headers, which is not to be parted."""

LOCATOR = "<locator><udpv4><port>{}</port><address>{}</address></udpv4></locator>"


def profile(route: Route) -> str:
    """Return the profile of a participant that hears on, and announces itself to, a route."""
    return PROFILE.format(
        own=route.own,
        own_locator=LOCATOR.format(route.own_port, route.own),
        peer_locator=LOCATOR.format(route.peer_port, route.peer),
    )
