"""What the log tells whoever started the node and reads nothing else."""

from std_srvs.srv import SetBool, Trigger

QUICK = {"preset": "li2007", "particles": 20, "image_reliability": "reliable"}


def test_services_and_what_came_of_them_are_logged(graph, client, images, box, capfd):
    graph.tracker(client, target_box=box, **QUICK)
    client.show(images[0], client.at(0))
    for service_type, name, request in (
        (SetBool, "enable", {"data": False}),
        (SetBool, "enable", {"data": True}),
        (Trigger, "stop", {}),
        (Trigger, "stop", {}),
    ):
        client.ask(service_type, name, **request)
    log = capfd.readouterr().err
    told = [
        "paused; images are not",
        "tracking goes on",
        "stopped 1 target; waiting",
        "there was no target",
    ]
    places = [log.index(text) for text in told]
    assert places == sorted(places)


def test_a_node_that_waits_for_a_manager_says_so(graph, capfd):
    graph.tracker(autostart=False, **QUICK)
    assert "waiting to be configured and activated" in capfd.readouterr().err


def test_a_target_that_comes_back_at_once_is_logged_as_tracked(graph, client, images, box, capfd):
    hiding = {"track__occluded_below": 0.3, "track__recovered_above": 0.4}
    graph.tracker(client, target_box=box, **QUICK, **hiding)
    client.show_all(images[:3])
    shown = 3

    def told(text):
        def look():
            nonlocal shown
            image = images[0] * 0 if "-> occluded" in text else images[2]
            client.show(image, client.at(shown))
            shown += 1
            log.append(capfd.readouterr().err)
            return text in "".join(log)

        return look

    log = []
    client.wait_for(told("tracking -> occluded"), "the hiding in the log")
    client.wait_for(told("occluded -> tracking"), "the return in the log")


def test_time_that_goes_back_is_a_warning_only_where_a_target_hangs_on_it(
    graph, client, images, box, capfd
):
    graph.tracker(client, **QUICK)
    client.show(images[0], client.at(30))
    client.show(images[0], client.at(0))
    assert "time went back by 1.200 s\n" in capfd.readouterr().err
    client.point_at(box)
    client.show(images[0], client.at(1))
    client.show(images[0], client.at(31))
    client.show(images[0], client.at(1))
    assert "time went back by 1.200 s; 'time_jump' is 'keep'; 'restart'" in capfd.readouterr().err


def test_following_the_cameras_is_logged(graph, capfd):
    # One that is known before there is a subscription is not followed.
    graph.tracker()
    camera = graph.client(reliability="BEST_EFFORT")
    log = []

    def is_told():
        log.append(capfd.readouterr().err)
        return "images on /image are subscribed to with best effort delivery" in "".join(log)

    camera.wait_for(is_told, "what they offer in the log")
