// The best grasp in a depth image, asked of a service that `icgnet serve` runs. Needs libcurl and nothing else:
//
//   g++ -std=c++17 -O2 predict.cpp -lcurl -o predict
//   ./predict http://127.0.0.1:8000 depth.png 631.5,631.2,638.4,366.5 1000
//
// The arguments are the address, a 16-bit PNG, fx,fy,cx,cy [pixels] and how many of its units are one metre. If the
// service wants a token, it is taken from the environment variable ICGNET_TOKEN.

#include <curl/curl.h>

#include <array>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

struct Grasp {
    double score, width, opening;  // width of the object and opening of the hand on its way [m]
    int instance;
    std::array<std::array<double, 4>, 4> pose;  // z approach, y closing, origin midway between the finger tips [m]
    std::string class_name;
};

struct Reply {
    long status = 0;
    std::string body;
};

static size_t append(char* data, size_t size, size_t count, void* target) {
    static_cast<std::string*>(target)->append(data, size * count);
    return size * count;
}

static std::vector<char> read_file(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) throw std::runtime_error("cannot read " + path);
    return {std::istreambuf_iterator<char>(file), {}};
}

static Reply post_png(const std::string& url, const std::vector<char>& png) {
    std::unique_ptr<CURL, decltype(&curl_easy_cleanup)> curl(curl_easy_init(), curl_easy_cleanup);
    if (!curl) throw std::runtime_error("libcurl does not start");
    curl_slist* list = curl_slist_append(nullptr, "Content-Type: image/png");
    if (const char* token = std::getenv("ICGNET_TOKEN")) {
        list = curl_slist_append(list, (std::string("Authorization: Bearer ") + token).c_str());
    }
    std::unique_ptr<curl_slist, decltype(&curl_slist_free_all)> headers(list, curl_slist_free_all);
    Reply reply;
    curl_easy_setopt(curl.get(), CURLOPT_URL, url.c_str());
    curl_easy_setopt(curl.get(), CURLOPT_HTTPHEADER, headers.get());
    curl_easy_setopt(curl.get(), CURLOPT_POSTFIELDS, png.data());
    curl_easy_setopt(curl.get(), CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(png.size()));
    curl_easy_setopt(curl.get(), CURLOPT_CONNECTTIMEOUT, 5L);
    curl_easy_setopt(curl.get(), CURLOPT_TIMEOUT, 60L);
    curl_easy_setopt(curl.get(), CURLOPT_WRITEFUNCTION, append);
    curl_easy_setopt(curl.get(), CURLOPT_WRITEDATA, &reply.body);
    const CURLcode code = curl_easy_perform(curl.get());
    if (code != CURLE_OK) throw std::runtime_error(std::string("no answer: ") + curl_easy_strerror(code));
    curl_easy_getinfo(curl.get(), CURLINFO_RESPONSE_CODE, &reply.status);
    return reply;
}

// The rows of answer=csv: 20 numbers (score, width, opening, instance_id and the pose row by row), then the class.
static std::vector<Grasp> parse(const std::string& table) {
    std::vector<Grasp> grasps;
    std::istringstream lines(table);
    std::string line, cell;
    std::getline(lines, line);  // names of the columns
    while (std::getline(lines, line)) {
        std::istringstream cells(line);
        std::array<double, 20> numbers;
        for (double& number : numbers) {
            if (!std::getline(cells, cell, ',')) throw std::runtime_error("a line of the answer is too short: " + line);
            number = std::stod(cell);
        }
        Grasp grasp{numbers[0], numbers[1], numbers[2], static_cast<int>(numbers[3]), {}, ""};
        for (int entry = 0; entry < 16; ++entry) grasp.pose[entry / 4][entry % 4] = numbers[4 + entry];
        std::getline(cells, grasp.class_name);
        grasps.push_back(grasp);
    }
    return grasps;
}

int main(int count, char** arguments) {
    if (count != 5) {
        std::fprintf(stderr, "usage: %s URL DEPTH.png FX,FY,CX,CY DEPTH_SCALE\n", arguments[0]);
        return 2;
    }
    curl_global_init(CURL_GLOBAL_DEFAULT);
    try {
        const std::string url = std::string(arguments[1]) + "/predict?answer=csv&limit=1&intrinsics=" + arguments[3] +
                                "&depth_scale=" + arguments[4];
        const Reply reply = post_png(url, read_file(arguments[2]));
        if (reply.status == 429 || reply.status == 503) {
            throw std::runtime_error("the service is busy, ask again later: " + reply.body);
        }
        if (reply.status != 200) throw std::runtime_error(std::to_string(reply.status) + " " + reply.body);
        const std::vector<Grasp> grasps = parse(reply.body);
        if (grasps.empty()) {
            std::printf("no grasp is free of collisions\n");
            return 0;
        }
        const Grasp& best = grasps.front();
        std::printf("best grasp: %s, object %d, score %.2f, opening %.4f m\n", best.class_name.c_str(), best.instance,
                    best.score, best.opening);
        for (const auto& row : best.pose) std::printf("%9.5f %9.5f %9.5f %9.5f\n", row[0], row[1], row[2], row[3]);
    } catch (const std::exception& error) {
        std::fprintf(stderr, "error: %s\n", error.what());
        return 1;
    }
    curl_global_cleanup();
}
