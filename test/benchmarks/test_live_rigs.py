"""What nodes say they have lost."""

from benchmarks.live_rigs import lost_by


def test_losses_are_summed_over_the_inputs_of_a_node():
    values = {
        "sphere_stitcher: input cameras/a/image_raw": {"received": "5", "lost": "2"},
        "sphere_stitcher: input cameras/b/image_raw": {"received": "5", "lost": "3"},
        "sphere_stitcher: callbacks": {"lost": "100"},
        "sphere_mapper: input sphere": {"received": "5", "lost": "7"},
        "sphere_mapper: mapping": {"spheres": "11"},
    }
    assert lost_by(values, "sphere_stitcher") == 5
    assert lost_by(values, "sphere_mapper") == 7
