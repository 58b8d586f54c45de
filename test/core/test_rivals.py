# Copyright 2026 haptic_accel maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from haptic_accel.core.rivals import Endpoint, rivals

endpoints = st.lists(
    st.builds(
        Endpoint,
        st.sampled_from(["/servo_cf", "/servo_cp"]),
        st.sampled_from(["/coupler", "/evil"]),
        st.sampled_from([b"1", b"2"]),
    ),
    max_size=4,
)


@given(endpoints)
def test_one_node_may_publish_one_of_each_topic_and_nothing_else_is_one_sender(
    found: list[Endpoint],
) -> None:
    senders = {(each.node, each.participant) for each in found}
    topics = [each.topic for each in found]
    assert (not rivals(found)) == (len(senders) <= 1 and len(topics) == len(set(topics)))


@given(endpoints)
def test_all_are_named_with_the_number_of_their_publishers(found: list[Endpoint]) -> None:
    said = rivals(found)
    for node in {each.node for each in found} if said else ():
        number = sum(each.node == node for each in found)
        assert (f"{node} ({number} publishers)" if number > 1 else node) in said
